"""Universal Robots UR5e with the Robotiq 85 gripper."""

from __future__ import annotations

from collections.abc import Iterable

from geoprior import RobotSpec, hookimpl
from geoprior.sim.robots.robot import Robot, RobotConfig

UR5E = Robot(
    name="ur5e",
    robosuite_name="UR5e",
    gripper="Robotiq85Gripper",
    home_joints=(-0.470, -1.735, 2.480, -2.275, -1.590, -1.991),
)


@hookimpl
def geoprior_robots() -> Iterable[RobotSpec]:
    """The paper's UR."""
    yield RobotSpec(
        name=UR5E.name,
        summary="Universal Robots UR5e, six joints, Robotiq 85 gripper",
        config=RobotConfig,
        factory=UR5E.driven,
    )
