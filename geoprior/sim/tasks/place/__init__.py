"""Place: put a cube into a low-walled enclosure; both are anywhere on the middle of the table, in any yaw."""

from geoprior.sim.tasks.place.task import geoprior_tasks

__all__ = ["geoprior_tasks"]
