"""Cable: a cable that lies bent on the table, and a coloured area to lay its plug into."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.sim.tasks.cable.small_cable import PLUG_HALF_SIZE, SEGMENTS, SmallCable, outline
from geoprior.sim.tasks.push.world import AREA_COLOUR, AREA_HEIGHT
from geoprior.sim.worlds.cube import turn_about_z
from geoprior.sim.worlds.tabletop import TABLE_TOP, Tabletop

from robosuite.models.objects import CylinderObject  # isort: skip - after the backend is chosen

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.tasks.cable.config import CableConfig

MIDDLE = np.array([-0.05, 0.0])
"""Middle of the rectangles of plug, area and cable in the workspace frame, metres."""

CABLE_REACH = np.array([0.17, 0.22])
"""Metres by which any part of the cable lies from the middle, at most: the third camera sees that far."""

SPARE = 0.02
"""Metres that the area keeps from the cable at first, at least."""

ON_TABLE = 0.004
"""Metres: a plug whose lowest corner is higher over the table than this does not lie there."""


class CableWorld(Tabletop):
    """A cable, and an area that is only looked at.

    Args:
        robot: The arm.
        setting: How it is seen and paced.
        config: Where cable and area may lie.
    """

    def __init__(self, robot: Robot, setting: Setting, config: CableConfig) -> None:
        self.config = config
        super().__init__(robot, setting)

    def make_objects(self) -> Sequence[Any]:
        """Cable and area."""
        self.cable = SmallCable("cable")
        self.area = CylinderObject(
            name="area",
            size=[self.config.radius, AREA_HEIGHT],
            rgba=AREA_COLOUR,
            joints=None,
            obj_type="visual",
        )
        # Its place is then part of the simulation's state and not of the model.
        self.area.get_obj().set("mocap", "true")
        return [self.cable, self.area]

    def place_objects(self, rng: np.random.Generator) -> None:
        """Plug and area in the configured rectangle, ``gap`` apart; the cable where there is room."""
        while not self._try_to_place(rng):
            pass

    def _try_to_place(self, rng: np.random.Generator) -> bool:
        reach = np.array([self.config.range_x, self.config.range_y])
        plug, area = MIDDLE + rng.uniform(-reach, reach, (2, 2))
        yaw, bends = rng.uniform(-np.pi, np.pi), self._draw_bends(rng)
        joints = outline(plug, yaw, bends)
        from_area = np.linalg.norm(joints - area, axis=1).min()
        if (
            np.linalg.norm(plug - area) < self.config.gap
            or from_area < self.config.radius + SPARE
            or (np.abs(joints - MIDDLE) > CABLE_REACH).any()
        ):
            return False
        self.put_cable(plug, yaw, bends)
        self.put_area(area)
        return True

    def _draw_bends(self, rng: np.random.Generator) -> FloatArray:
        """(`SEGMENTS`,) radians: a bow whose either half may turn more than the other, or the other way."""
        most = np.radians(self.config.bend) / SEGMENTS
        near, far = rng.uniform(-most, most, 2)
        bends: FloatArray = np.linspace(near, far, SEGMENTS)
        return bends

    def put_cable(self, position: FloatArray, yaw: float, bends: FloatArray) -> None:
        """Lay the cable flat on the table, at rest.

        Args:
            position: (2,) of the plug's middle in the workspace frame, metres.
            yaw: Radians about the vertical, of the plug's x axis: out of the cable.
            bends: (`SEGMENTS`,) radians about the vertical at each joint, the plug's first.
        """
        data, (plug, *_) = self.sim.data, self.cable.joints
        centre = TABLE_TOP + np.array([*position, PLUG_HALF_SIZE[2]])
        data.set_joint_qpos(plug, np.concatenate([centre, turn_about_z(yaw)]))
        data.set_joint_qvel(plug, np.zeros(6))
        for joint, bend in zip(self.cable.ball_joints, bends, strict=True):
            data.set_joint_qpos(joint, np.array([np.cos(bend / 2.0), np.sin(bend / 2.0), 0.0, 0.0]))
            data.set_joint_qvel(joint, np.zeros(3))

    def put_area(self, position: FloatArray) -> None:
        """Set the area up.

        Args:
            position: (2,) of its middle in the workspace frame, metres.
        """
        self.sim.data.set_mocap_pos(self.area.root_body, TABLE_TOP + np.array([*position, 0.0]))

    def transform_plug_to_workspace(self) -> FloatArray:
        """(4, 4) of the plug: origin in its middle, x along the cable and out of it, z up."""
        return self.transform_object_to_workspace(self.cable)

    def plug_from_area(self) -> FloatArray:
        """(3,) from the area's middle on the table to the plug's middle, workspace axes, metres."""
        plug, area = (self.transform_object_to_workspace(each) for each in (self.cable, self.area))
        offset: FloatArray = plug[:3, 3] - area[:3, 3]
        return offset

    def plug_clearance(self) -> float:
        """Height of the plug's lowest corner over the table, metres."""
        upward = self.transform_plug_to_workspace()[2]
        return float(upward[3] - np.abs(upward[:3]) @ PLUG_HALF_SIZE)

    def plug_in_area(self) -> bool:
        """Whether the plug lies on the table with its middle over the area."""
        beside = np.linalg.norm(self.plug_from_area()[:2])
        return bool(beside < self.config.radius and self.plug_clearance() < ON_TABLE)

    def succeeded(self) -> bool:
        """The plug lies in the area, at rest, and the gripper does not touch the cable."""
        return self.plug_in_area() and self.object_at_rest(self.cable) and not self.object_in_hand(self.cable)

    def failure(self) -> str:
        """The plug fell off the table."""
        return "dropped" if self.transform_plug_to_workspace()[2, 3] < -PLUG_HALF_SIZE[2] else ""
