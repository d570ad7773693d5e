"""Built-in tasks, one plug-in module each."""
