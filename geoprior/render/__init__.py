"""From points to frames."""
