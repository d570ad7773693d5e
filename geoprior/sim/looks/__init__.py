"""Built-in looks of the simulated world, one plug-in module each."""
