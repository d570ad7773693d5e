"""Can: lift a can that stands anywhere on the middle of the table."""

from geoprior.sim.tasks.can.task import geoprior_tasks

__all__ = ["geoprior_tasks"]
