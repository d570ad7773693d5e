"""Built-in arms, one plug-in module each."""
