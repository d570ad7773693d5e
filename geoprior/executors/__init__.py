"""Engines that run independent pieces of work side by side."""
