"""UFactory xArm7 with its own gripper."""

from __future__ import annotations

from collections.abc import Iterable

from geoprior import RobotSpec, hookimpl
from geoprior.sim.robots.robot import Robot, RobotConfig

XARM7 = Robot(
    name="xarm7",
    robosuite_name="XArm7",
    gripper="XArm7Gripper",
    home_joints=(0.0, 0.0, 0.0, 1.2252, 0.0, 1.2252, 0.0),
    # Its grip site is turned by a quarter: fingers along y, where the Robotiq's are along x.
    # Its gripper's body is thicker.
    camera_position=(0.0, 0.075, -0.11),
    closed_fingers=(0.014, 0.030, 0.026),
    rotation_hand_to_site=((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
)


@hookimpl
def geoprior_robots() -> Iterable[RobotSpec]:
    """The paper's xArm."""
    yield RobotSpec(
        name=XARM7.name,
        summary="UFactory xArm7, seven joints, its own gripper",
        config=RobotConfig,
        factory=XARM7.driven,
    )
