"""The Franka Panda with its own gripper."""

from __future__ import annotations

import math
from collections.abc import Iterable

from geoprior import RobotSpec, hookimpl
from geoprior.sim.robots.robot import Robot, RobotConfig

PANDA = Robot(
    name="panda",
    robosuite_name="Panda",
    gripper="PandaGripper",
    home_joints=(0.0, 0.2, 0.0, -2.1, 0.0, 2.3, -math.pi / 4.0),
    camera_position=(0.0, 0.075, -0.10),
    closed_fingers=(0.030, 0.018, 0.009),
)


@hookimpl
def geoprior_robots() -> Iterable[RobotSpec]:
    """One arm."""
    yield RobotSpec(
        name=PANDA.name,
        summary="Franka Panda, seven joints, its own gripper",
        config=RobotConfig,
        factory=PANDA.driven,
    )
