"""Built-in solids, one plug-in module each; a new file here is found by itself."""
