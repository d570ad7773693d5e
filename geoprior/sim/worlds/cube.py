"""A cube on the table: the object of pick, place and push."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.sim.worlds.tabletop import TABLE_TOP, Tabletop

from robosuite.models.objects import BoxObject  # isort: skip - after the backend is chosen

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray

CUBE_HALF_SIZE = 0.021
CUBE_COLOUR = (0.80, 0.10, 0.08, 1.0)


class CubeWorld(Tabletop):
    """A world with one cube; see `Tabletop`."""

    def make_cube(self) -> Any:
        """A cube of robosuite's density and friction for objects."""
        return BoxObject(name="cube", size=[CUBE_HALF_SIZE] * 3, rgba=CUBE_COLOUR)

    def make_objects(self) -> Sequence[Any]:
        """The cube alone."""
        self.cube = self.make_cube()
        return [self.cube]

    def put_cube(self, position: FloatArray, yaw: float) -> None:
        """Lay the cube flat on the table.

        Args:
            position: (2,) of its centre in the workspace frame, metres.
            yaw: Radians about the vertical.
        """
        centre = TABLE_TOP + np.array([*position, CUBE_HALF_SIZE])
        self.sim.data.set_joint_qpos(self.cube.joints[0], np.concatenate([centre, turn_about_z(yaw)]))

    def cube_position(self) -> FloatArray:
        """(3,) centre of the cube in the workspace frame, metres."""
        position: FloatArray = self.transform_object_to_workspace(self.cube)[:3, 3]
        return position

    def aim_points(self) -> Mapping[str, FloatArray]:
        """The cube's centre; see `Tabletop.aim_points`."""
        return {"object": self.cube_position()}

    def cube_yaw(self) -> float:
        """Radians about the vertical, of a cube that lies flat."""
        rotation = self.transform_object_to_workspace(self.cube)
        return float(np.arctan2(rotation[1, 0], rotation[0, 0]))

    def cube_clearance(self) -> float:
        """Height of the cube's lowest corner over the table, metres."""
        upward = self.transform_object_to_workspace(self.cube)[2]
        return float(upward[3] - CUBE_HALF_SIZE * np.abs(upward[:3]).sum())

    def failure(self) -> str:
        """The cube fell off the table."""
        return "dropped" if self.cube_position()[2] < -CUBE_HALF_SIZE else ""


def turn_about_z(yaw: float) -> FloatArray:
    """(4,) MuJoCo's quaternion (w, x, y, z) of a turn by ``yaw`` radians about the vertical."""
    return np.array([np.cos(yaw / 2.0), 0.0, 0.0, np.sin(yaw / 2.0)])
