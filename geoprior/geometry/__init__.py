"""Poses, interpolation, cameras and seeds."""
