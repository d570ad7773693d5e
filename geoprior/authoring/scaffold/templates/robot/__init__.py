"""My-plugin: an arm of robosuite's, as a robot of geoprior's.

To take another arm, write its name in robosuite, its gripper and a posture; `geoprior plugins check` says
whether the hand frame is right and the arm goes where it is sent.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from geoprior import RobotSpec, hookimpl
from geoprior.sim.robots.robot import Robot, RobotConfig

MY_PLUGIN = Robot(
    name="my-plugin",
    robosuite_name="IIWA",
    gripper="Robotiq85Gripper",
    # Any posture with the open hand over the middle of the table, pointing down; radians.
    home_joints=(0.0, 0.65, 0.0, -1.89, 0.0, 0.6, -math.pi / 2.0),
    # Where the hand's camera sits: (right, up, forward) from the finger tips, metres.
    camera_position=(0.0, 0.06, -0.10),
    # How wide the closed tips are along right and up, and how far they reach along forward, metres.
    closed_fingers=(0.039, 0.022, 0.008),
)


@hookimpl
def geoprior_robots() -> Iterable[RobotSpec]:
    """What this package adds."""
    yield RobotSpec(
        name=MY_PLUGIN.name,
        summary="KUKA LBR iiwa, seven joints, Robotiq 85 gripper",
        config=RobotConfig,
        factory=MY_PLUGIN.driven,
    )
