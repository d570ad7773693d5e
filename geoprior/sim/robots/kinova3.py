"""Kinova Gen3 with the Robotiq 85 gripper."""

from __future__ import annotations

import math
from collections.abc import Iterable

from geoprior import RobotSpec, hookimpl
from geoprior.sim.robots.robot import Robot, RobotConfig

KINOVA3 = Robot(
    name="kinova3",
    robosuite_name="Kinova3",
    gripper="Robotiq85Gripper",
    home_joints=(0.0, 0.65, 0.0, 1.89, 0.0, 0.6, -math.pi / 2.0),
)


@hookimpl
def geoprior_robots() -> Iterable[RobotSpec]:
    """The paper's Kinova."""
    yield RobotSpec(
        name=KINOVA3.name,
        summary="Kinova Gen3, seven joints, Robotiq 85 gripper",
        config=RobotConfig,
        factory=KINOVA3.driven,
    )
