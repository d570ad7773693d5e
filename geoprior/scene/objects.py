"""The one object of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.interpolate import rotations_about
from geoprior.geometry.se3 import apply, make_transform
from geoprior.scene.mesh import centred, extents, points_for_density, sample_surface

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.config import ObjectConfig
    from geoprior.scene.floor import Floor
    from geoprior.scene.mesh import Mesh

    FloatArray = NDArray[np.float64]

WORLD_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class SceneObject:
    """A solid resting on the floor.

    Attributes:
        mesh: The solid in the object frame, whose origin is the middle of its bounding box. That point is
            *the* centre of the object everywhere: what hands point at, c_obj of the paper's equations.
        points: (P, 3) surface points in the object frame.
        transform_object_to_world: (4, 4) at the start.
        yaw: Of that transform about world z, radians.
    """

    mesh: Mesh
    points: FloatArray
    transform_object_to_world: FloatArray
    yaw: float

    @property
    def centre(self) -> FloatArray:
        """(3,) c_obj in the world, metres."""
        return np.asarray(self.transform_object_to_world[:3, 3])

    @property
    def vertices(self) -> FloatArray:
        """(V, 3) the mesh's vertices in the world, metres."""
        return apply(self.transform_object_to_world, self.mesh.vertices)


def draw_object(config: ObjectConfig, mesh: Mesh, floor: Floor, rng: np.random.Generator) -> SceneObject:
    """Rest a solid on the floor at a random place and yaw, and sample its surface."""
    mesh = centred(mesh)
    yaw = float(rng.uniform(-np.pi, np.pi))
    x, y = rng.uniform(-config.reach, config.reach, 2)
    position = np.array([x, y, floor.height + 0.5 * extents(mesh)[2]])
    rotation = rotations_about(WORLD_UP, np.array([yaw]))[0]
    points = sample_surface(mesh, points_for_density(mesh, config.density), rng)
    return SceneObject(mesh, points, make_transform(rotation, position), yaw)
