"""Which geometries a camera can see at all: those whose box reaches into its field of view.

A software renderer transforms and lights every vertex that it is given, seen or not. What is left out here
lies wholly on the outer side of one of the planes that bound the picture, so that no pixel changes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from typing import TYPE_CHECKING

import mujoco
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    BoolArray = NDArray[np.bool_]

HIDDEN_GROUP = mujoco.mjNGROUP - 1
"""A geometry group that nobody looks at."""

_SIGNS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


class Boxes:
    """The boxes around the geometries of one group, turned as the geometries are.

    Args:
        model: The model.
        group: Number of the geometry group.
    """

    def __init__(self, model: mujoco.MjModel, group: int) -> None:
        self.model = model
        self._geoms = np.flatnonzero(model.geom_group == group)
        centre, half_sizes = model.geom_aabb[self._geoms, None, :3], model.geom_aabb[self._geoms, None, 3:]
        self._corners = centre + half_sizes * _SIGNS

    def of(self, model: mujoco.MjModel) -> Boxes:
        """The boxes of a model with the same geometries, whose groups are its own."""
        other = copy(self)
        other.model = model
        return other

    def corners(self, data: mujoco.MjData) -> FloatArray:
        """(G, 8, 3) corners now, in the world frame, metres."""
        rotations = data.geom_xmat[self._geoms].reshape(-1, 3, 3)
        turned = self._corners @ rotations.transpose(0, 2, 1)
        corners: FloatArray = turned + data.geom_xpos[self._geoms, None]
        return corners

    def outside(self, data: mujoco.MjData, corners: FloatArray, camera: int, aspect: float) -> BoolArray:
        """(G,) whether a geometry cannot be in the picture.

        Args:
            data: With positions of cameras up to date.
            corners: What `corners` says.
            camera: Number of a camera that is given by its vertical field of view.
            aspect: Columns over rows of its picture.
        """
        high = np.tan(np.radians(self.model.cam_fovy[camera]) / 2.0)
        wide = aspect * high
        # Outward normals of the pyramid's sides and of the plane through its tip; MuJoCo's cameras look
        # along -z.
        normals = np.array(
            [[1.0, -1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0, 0.0], [wide, wide, high, high, 1.0]]
        )
        in_world = data.cam_xmat[camera].reshape(3, 3) @ normals
        beyond = (corners - data.cam_xpos[camera]) @ in_world > 0.0
        outside: BoolArray = beyond.all(axis=1).any(axis=1)
        return outside

    @contextmanager
    def hidden(self, outside: BoolArray) -> Iterator[None]:
        """Context in which geometries are in `HIDDEN_GROUP`. Physics does not ask for the group."""
        geoms = self._geoms[outside]
        groups = self.model.geom_group[geoms]
        self.model.geom_group[geoms] = HIDDEN_GROUP
        try:
            yield
        finally:
            self.model.geom_group[geoms] = groups
