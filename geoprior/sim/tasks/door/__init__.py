"""Door: pull a small door open that stands anywhere on a part of the table."""

from geoprior.sim.tasks.door.task import geoprior_tasks

__all__ = ["geoprior_tasks"]
