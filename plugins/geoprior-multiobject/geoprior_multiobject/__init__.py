"""Motions that relate several objects. Each module registers one."""
