"""Built-in motions of the hand, one plug-in module each."""
