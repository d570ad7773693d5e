"""Stack: a cube, and another one of another colour to put it onto."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.sim.worlds.cube import CUBE_HALF_SIZE, CubeWorld, turn_about_z
from geoprior.sim.worlds.goal import MIDDLE
from geoprior.sim.worlds.placing import draw_two_places
from geoprior.sim.worlds.tabletop import TABLE_TOP

from robosuite.models.objects import BoxObject  # isort: skip - after the backend is chosen

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.tasks.stack.config import StackConfig

BASE_COLOUR = (0.10, 0.25, 0.70, 1.0)

FLAT = np.cos(np.radians(5.0))
"""Cosine between the vertical and the nearest edge of a cube that lies on a face."""

ON_TOP = 0.003
"""Metres by which a cube's centre may be higher or lower than what it lies on allows."""


class StackWorld(CubeWorld):
    """A cube to put onto a base, which is a cube as well and can be pushed about.

    Args:
        robot: The arm.
        setting: How it is seen and paced.
        config: Where the two may lie.
    """

    def __init__(self, robot: Robot, setting: Setting, config: StackConfig) -> None:
        self.config = config
        super().__init__(robot, setting)

    def make_objects(self) -> Sequence[Any]:
        """Cube and base."""
        self.base = BoxObject(name="base", size=[CUBE_HALF_SIZE] * 3, rgba=BASE_COLOUR)
        return [*super().make_objects(), self.base]

    def place_objects(self, rng: np.random.Generator) -> None:
        """Anywhere in the configured rectangle, ``gap`` apart, each with any yaw."""
        cube, base = draw_two_places(rng, MIDDLE, self.config)
        cube_yaw, base_yaw = rng.uniform(-np.pi, np.pi, 2)
        self.put_cube(cube, cube_yaw)
        self.put_base(base, base_yaw)

    def put_base(self, position: FloatArray, yaw: float) -> None:
        """Lay the base flat on the table; see `put_cube`."""
        centre = TABLE_TOP + np.array([*position, CUBE_HALF_SIZE])
        self.sim.data.set_joint_qpos(self.base.joints[0], np.concatenate([centre, turn_about_z(yaw)]))

    def base_position(self) -> FloatArray:
        """(3,) centre of the base in the workspace frame, metres."""
        position: FloatArray = self.transform_object_to_workspace(self.base)[:3, 3]
        return position

    def cube_over_base(self) -> FloatArray:
        """(3,) from one edge above the base's centre to the cube's, workspace axes, metres."""
        above = np.array([0.0, 0.0, 2.0 * CUBE_HALF_SIZE])
        offset: FloatArray = self.cube_position() - self.base_position() - above
        return offset

    def succeeded(self) -> bool:
        """The cube lies on the base, both at rest, and the gripper does not touch the cube."""
        return (
            self.cube_on_base()
            and all(self.object_at_rest(each) for each in (self.cube, self.base))
            and not self.object_in_hand(self.cube)
        )

    def cube_on_base(self) -> bool:
        """Whether the base lies flat on the table, and the cube flat on the base, its centre over the top."""
        cube, base = (self.transform_object_to_workspace(each) for each in (self.cube, self.base))
        # Each may lie on any of its faces.
        flat = min(np.abs(each[2, :3]).max() for each in (cube, base)) > FLAT
        heights = abs(self.cube_over_base()[2]), abs(base[2, 3] - CUBE_HALF_SIZE)
        sideways = base[:3, :3].T @ (self.cube_over_base() * [1.0, 1.0, 0.0])
        return bool(flat and max(heights) < ON_TOP and np.abs(sideways).max() < CUBE_HALF_SIZE)

    def failure(self) -> str:
        """Cube or base fell off the table."""
        return "dropped" if self.base_position()[2] < -CUBE_HALF_SIZE else super().failure()
