"""Is this machine fit, and if not, which line mends it."""
