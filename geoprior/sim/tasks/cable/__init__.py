"""Cable: lay the plug of a cable into a coloured area; both are anywhere on the middle of the table."""

from geoprior.sim.tasks.cable.task import geoprior_tasks

__all__ = ["geoprior_tasks"]
