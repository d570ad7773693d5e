"""Pick: one cube anywhere on the middle of the table."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.sim.worlds.cube import CUBE_HALF_SIZE, CubeWorld

if TYPE_CHECKING:
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.tasks.pick.config import PickConfig


class PickWorld(CubeWorld):
    """A cube to lift.

    Args:
        robot: The arm.
        setting: How it is seen and paced.
        config: The cube's range and how high to lift it.
    """

    def __init__(self, robot: Robot, setting: Setting, config: PickConfig) -> None:
        self.config = config
        super().__init__(robot, setting)

    def place_objects(self, rng: np.random.Generator) -> None:
        """Anywhere in the configured rectangle, with any yaw."""
        reach = np.array([self.config.range_x, self.config.range_y])
        self.put_cube(rng.uniform(-reach, reach), rng.uniform(-np.pi, np.pi))

    def succeeded(self) -> bool:
        """The cube's underside is ``lift`` above the table."""
        return bool(self.cube_position()[2] - CUBE_HALF_SIZE > self.config.lift)
