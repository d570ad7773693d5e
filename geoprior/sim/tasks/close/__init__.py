"""Close: shut a small door that stands open anywhere on a part of the table."""

from geoprior.sim.tasks.close.task import geoprior_tasks

__all__ = ["geoprior_tasks"]
