"""Scripted experts. They see the simulator's state; policies never do."""
