"""Push: move a cube to a coloured area without lifting it; both are anywhere on the middle of the table."""

from geoprior.sim.tasks.push.task import geoprior_tasks

__all__ = ["geoprior_tasks"]
