"""The synthetic scene: floor, object, hand and marker."""
