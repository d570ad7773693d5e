"""Pile: put a bottle onto a can; both stand anywhere on the middle of the table."""

from geoprior.sim.tasks.pile.task import geoprior_tasks

__all__ = ["geoprior_tasks"]
