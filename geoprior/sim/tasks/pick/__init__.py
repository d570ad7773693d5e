"""Pick: lift a cube that lies anywhere on the middle of the table, in any yaw."""

from geoprior.sim.tasks.pick.task import geoprior_tasks

__all__ = ["geoprior_tasks"]
