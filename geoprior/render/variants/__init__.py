"""Built-in ablations of what the cameras see, one plug-in module each."""
