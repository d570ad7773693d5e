"""Robosuite arms, tasks, demonstrations and rollouts."""
