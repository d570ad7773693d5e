"""Stack: put a cube onto another; both lie anywhere on the middle of the table, in any yaw."""

from geoprior.sim.tasks.stack.task import geoprior_tasks

__all__ = ["geoprior_tasks"]
