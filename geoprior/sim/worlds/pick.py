"""Pick: one cube anywhere on the middle of the table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.sim.worlds.tabletop import TABLE_TOP, Tabletop

from robosuite.models.objects import BoxObject  # isort: skip - after the backend is chosen

if TYPE_CHECKING:
    from geoprior.geometry.camera import CamerasConfig
    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.tasks.pick import PickConfig

CUBE_HALF_SIZE = 0.021
CUBE_COLOUR = (0.80, 0.10, 0.08, 1.0)


class PickWorld(Tabletop):
    """A cube to lift.

    Args:
        robot: The arm.
        cameras: Fields of view.
        control_rate: Commands a second.
        config: The cube's range and how high to lift it.
    """

    def __init__(self, robot: Robot, cameras: CamerasConfig, control_rate: int, config: PickConfig) -> None:
        self.config = config
        super().__init__(robot, cameras, control_rate)

    def make_objects(self) -> Sequence[Any]:
        """The cube, of robosuite's density and friction for objects."""
        self.cube = BoxObject(name="cube", size=[CUBE_HALF_SIZE] * 3, rgba=CUBE_COLOUR)
        return [self.cube]

    def place_objects(self, rng: np.random.Generator) -> None:
        """Anywhere in the configured rectangle, with any yaw."""
        reach = np.array([self.config.range_x, self.config.range_y])
        position = rng.uniform(-reach, reach)
        yaw = rng.uniform(-np.pi, np.pi)
        centre = TABLE_TOP + np.array([*position, CUBE_HALF_SIZE])
        turn = np.array([np.cos(yaw / 2.0), 0.0, 0.0, np.sin(yaw / 2.0)])
        self.sim.data.set_joint_qpos(self.cube.joints[0], np.concatenate([centre, turn]))

    def cube_position(self) -> FloatArray:
        """(3,) centre of the cube in the workspace frame, metres."""
        position: FloatArray = np.array(self.sim.data.get_body_xpos(self.cube.root_body)) - TABLE_TOP
        return position

    def cube_yaw(self) -> float:
        """Radians about the vertical, of a cube that lies flat."""
        rotation = np.array(self.sim.data.get_body_xmat(self.cube.root_body)).reshape(3, 3)
        return float(np.arctan2(rotation[1, 0], rotation[0, 0]))

    def succeeded(self) -> bool:
        """The cube's underside is ``lift`` above the table."""
        return bool(self.cube_position()[2] - CUBE_HALF_SIZE > self.config.lift)

    def failure(self) -> str:
        """The cube fell off the table."""
        return "dropped" if self.cube_position()[2] < -CUBE_HALF_SIZE else ""
