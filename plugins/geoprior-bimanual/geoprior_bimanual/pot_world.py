"""A pot with two handles between two arms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.geometry.se3 import apply
from geoprior.sim.arm import Arm
from geoprior.sim.worlds.cube import turn_about_z
from geoprior.sim.worlds.tabletop import TABLE_TOP, Tabletop
from geoprior_bimanual import LEFT, RIGHT

from robosuite.models.objects import PotWithHandlesObject  # isort: skip - after the backend is chosen

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior_bimanual.lift_pot import LiftPotConfig

HALF_SIZE = np.array([0.06, 0.06, 0.05])
"""Of the pot's body, metres; its origin is in the middle."""

HANDLE_LENGTH, HANDLE_RADIUS = 0.08, 0.009
HANDLE = np.array([0.0, HALF_SIZE[1] + HANDLE_LENGTH, HALF_SIZE[2] - HANDLE_RADIUS])
"""Middle of the left handle's bar in the pot's frame; the bar lies along the pot's x. Metres."""

DENSITY = 350.0
"""Kilogrammes a cubic metre: a pot of 260 g."""

BASE_OFFSET, START_OFFSET = 0.3, 0.16
"""Metres along y from the middle to either arm's base, and to the middle of where its hand starts."""


class PotWorld(Tabletop):
    """Two arms side by side, and a pot to lift.

    Args:
        robot: The arm on the left.
        partner: The arm on the right.
        setting: How they are seen and paced.
        config: Where the pot may stand, and how high and level to lift it.
    """

    third_camera = (np.array([0.60, 0.28, 0.60]), np.array([-0.02, -0.03, 0.11]))

    def __init__(self, robot: Robot, partner: Robot, setting: Setting, config: LiftPotConfig) -> None:
        self.partner, self.config = partner, config
        super().__init__(robot, setting)

    def make_arms(self, robot: Robot) -> Sequence[Arm]:
        """One on either side, both facing +x."""
        x, _, z = Arm.start
        return [
            Arm(robot, LEFT, (0.0, BASE_OFFSET), (x, START_OFFSET, z)),
            Arm(self.partner, RIGHT, (0.0, -BASE_OFFSET), (x, -START_OFFSET, z)),
        ]

    def make_objects(self) -> Sequence[Any]:
        """The pot of robosuite, smaller and lighter, in plain colours."""
        self.pot = PotWithHandlesObject(
            name="pot",
            body_half_size=tuple(HALF_SIZE),
            handle_length=HANDLE_LENGTH,
            handle_radius=HANDLE_RADIUS,
            density=DENSITY,
            use_texture=False,
            rgba_body=(0.75, 0.12, 0.10, 1.0),
            rgba_handle_0=(0.15, 0.50, 0.20, 1.0),
            rgba_handle_1=(0.15, 0.25, 0.65, 1.0),
        )
        return [self.pot]

    def place_objects(self, rng: np.random.Generator) -> None:
        """Anywhere in the configured ranges."""
        config = self.config
        reach = np.array([config.range_x, config.range_y, np.radians(config.range_yaw)])
        x, y, yaw = rng.uniform(-reach, reach)
        self.put_pot(np.array([x, y, 0.0]), yaw)

    def put_pot(self, position: FloatArray, yaw: float) -> None:
        """Set the pot up, at rest.

        Args:
            position: (3,) of the middle of its foot in the workspace frame, metres.
            yaw: Radians about the vertical.
        """
        centre = TABLE_TOP + position + np.array([0.0, 0.0, HALF_SIZE[2]])
        self.sim.data.set_joint_qpos(self.pot.joints[0], np.concatenate([centre, turn_about_z(yaw)]))
        self.sim.data.set_joint_qvel(self.pot.joints[0], np.zeros(6))

    def handles(self) -> dict[str, FloatArray]:
        """(3,) the middle of each hand's handle in the workspace frame, metres."""
        mirrored = HANDLE * np.array([1.0, -1.0, 1.0])
        places = apply(self.transform_object_to_workspace(self.pot), np.stack([HANDLE, mirrored]))
        return dict(zip(self.hands, places, strict=True))

    def pot_yaw(self) -> float:
        """Radians about the vertical, of a pot that stands level."""
        rotation = self.transform_object_to_workspace(self.pot)
        return float(np.arctan2(rotation[1, 0], rotation[0, 0]))

    def pot_clearance(self) -> float:
        """Height of the pot's lowest corner over the table, metres."""
        upward = self.transform_object_to_workspace(self.pot)[2]
        return float(upward[3] - np.abs(upward[:3]) @ HALF_SIZE)

    def succeeded(self) -> bool:
        """All of the pot is ``lift`` above the table, and it leans by ``tilt`` at most."""
        level = self.transform_object_to_workspace(self.pot)[2, 2] > np.cos(np.radians(self.config.tilt))
        return bool(level and self.pot_clearance() > self.config.lift)

    def failure(self) -> str:
        """The pot fell off the table."""
        height = self.transform_object_to_workspace(self.pot)[2, 3]
        return "dropped" if height < -HALF_SIZE[2] else ""
