"""Door: a small door that stands anywhere on a part of the table, turned more or less to the arm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.geometry.se3 import make_transform
from geoprior.sim.tasks.door.small_door import POST_OFFSET, SmallDoor
from geoprior.sim.worlds.cube import turn_about_z
from geoprior.sim.worlds.tabletop import START_POSITION, TABLE_TOP, Tabletop

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.tasks.door.config import DoorConfig

MIDDLE = np.array([-0.155, -0.185])
"""Middle of the rectangle in which the door stands, workspace frame, metres. Farther out, the Kinova's elbow
comes to be stretched when its hand is at the handle; nearer, the UR5e's folds up as the door opens."""

FACING = np.radians(170.0)
"""Yaw of the door in the middle of its range: its handle's side looks along +y and a little towards +x, so
that the arm, from -x, reaches the handle, and the third camera, from +x and +y, sees it."""

CLEARANCE = 0.14
"""Metres from above between the panel and the middle of where the hand starts: an open gripper is 0.15 m
wide, and it starts up to 0.04 m away from there."""


class DoorWorld(Tabletop):
    """A door to pull open.

    Args:
        robot: The arm.
        setting: How it is seen and paced.
        config: Where the door may stand, and how far it must open.
    """

    def __init__(self, robot: Robot, setting: Setting, config: DoorConfig) -> None:
        self.config = config
        super().__init__(robot, setting)

    def make_objects(self) -> Sequence[Any]:
        """The door."""
        self.door = SmallDoor("door")
        return [self.door]

    def place_objects(self, rng: np.random.Generator) -> None:
        """Shut, anywhere in the configured rectangle and range of yaws where the hand does not start."""
        reach = np.array([self.config.range_x, self.config.range_y, np.radians(self.config.range_yaw)])
        middle = np.array([*MIDDLE, FACING])
        x, y, yaw = middle + rng.uniform(-reach, reach)
        while _distance_to_panel(START_POSITION[:2], np.array([x, y]), yaw) < CLEARANCE:
            x, y, yaw = middle + rng.uniform(-reach, reach)
        self.put_door(np.array([x, y]), yaw)

    def put_door(self, position: FloatArray, yaw: float, angle: float = 0.0) -> None:
        """Set the door up, at rest.

        Args:
            position: (2,) of the closed panel's middle in the workspace frame, metres.
            yaw: Radians about the vertical; at zero the handle's side looks along -y.
            angle: Radians by which it is open.
        """
        self.sim.data.set_mocap_pos(self.door.root_body, TABLE_TOP + np.array([*position, 0.0]))
        self.sim.data.set_mocap_quat(self.door.root_body, turn_about_z(yaw))
        self.sim.data.set_joint_qpos(self.door.hinge_joint, angle)
        self.sim.data.set_joint_qvel(self.door.hinge_joint, 0.0)

    def hinge_angle(self) -> float:
        """Radians by which the door is open."""
        return float(self.sim.data.get_joint_qpos(self.door.hinge_joint))

    def hinge_position(self) -> FloatArray:
        """(3,) a point of the hinge's vertical axis in the workspace frame, metres."""
        data, model = self.sim.data._data, self.sim.model._model
        position: FloatArray = np.array(data.xanchor[model.joint(self.door.hinge_joint).id]) - TABLE_TOP
        return position

    def transform_handle_to_workspace(self) -> FloatArray:
        """(4, 4) of the handle: origin in the bar's middle, x along it to the hinge, z up, y to the panel."""
        site = self.sim.model.site_name2id(self.door.important_sites["handle"])
        rotation = np.array(self.sim.data.site_xmat[site]).reshape(3, 3)
        return make_transform(rotation, np.array(self.sim.data.site_xpos[site]) - TABLE_TOP)

    def succeeded(self) -> bool:
        """The door is open by more than ``angle``."""
        return self.hinge_angle() > self.config.angle


def _distance_to_panel(point: FloatArray, middle: FloatArray, yaw: float) -> float:
    """Metres, seen from above, from a point (2,) to the shut panel with its posts."""
    half = POST_OFFSET * np.array([np.cos(yaw), np.sin(yaw)])
    share = np.clip((point - middle) @ half / (half @ half), -1.0, 1.0)
    return float(np.linalg.norm(point - middle - share * half))
