"""Plug-ins: the hooks, what they yield, and the manager that finds them."""
