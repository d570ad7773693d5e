"""The objects of a scene: the one that the hand has to do with, and others beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.interpolate import rotations_about
from geoprior.geometry.se3 import apply, make_transform
from geoprior.scene.mesh import centred, extents, points_for_density, sample_surface
from geoprior.scene.ranges import uniform
from geoprior.scene.rejection import draw_until

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.config import ObjectConfig, OtherConfig
    from geoprior.scene.floor import Floor
    from geoprior.scene.mesh import Mesh

    FloatArray = NDArray[np.float64]

WORLD_UP = np.array([0.0, 0.0, 1.0])
OBJECT = "object"
"""Name of the object that every scene has; a motion's spec may name others."""


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

    @property
    def radius(self) -> float:
        """Of the circle about the centre, seen from above, that holds the whole object, metres."""
        return float(np.linalg.norm(self.mesh.vertices[:, :2], axis=1).max())


def draw_object(config: ObjectConfig, mesh: Mesh, floor: Floor, rng: np.random.Generator) -> SceneObject:
    """Rest a solid on the floor at a random place and yaw, and sample its surface."""
    mesh = centred(mesh)
    yaw = float(rng.uniform(-np.pi, np.pi))
    place = rng.uniform(-config.reach, config.reach, 2)
    points = sample_surface(mesh, points_for_density(mesh, config.density), rng)
    return SceneObject(mesh, points, _resting(mesh, place, yaw, floor), yaw)


def rest_object(
    mesh: Mesh, density: float, place: FloatArray, floor: Floor, rng: np.random.Generator
) -> SceneObject:
    """Rest a solid on the floor at (x, y) at a random yaw, and sample its surface."""
    mesh = centred(mesh)
    yaw = float(rng.uniform(-np.pi, np.pi))
    points = sample_surface(mesh, points_for_density(mesh, density), rng)
    return SceneObject(mesh, points, _resting(mesh, place, yaw, floor), yaw)


def draw_beside(
    config: OtherConfig,
    density: float,
    mesh: Mesh,
    floor: Floor,
    objects: Sequence[SceneObject],
    rng: np.random.Generator,
) -> SceneObject:
    """Rest a solid wholly on the floor, clear of the objects that are there.

    Args:
        config: How far from the first object, and how clear of all.
        density: Of its points; see `ObjectConfig`.
        mesh: The solid.
        floor: Where it rests.
        objects: What is there, one at least.
        rng: Draws.

    Raises:
        ConfigError: There is no room for it.
    """
    mesh = centred(mesh)
    yaw = float(rng.uniform(-np.pi, np.pi))
    points = sample_surface(mesh, points_for_density(mesh, density), rng)

    def draw() -> SceneObject:
        direction, distance = float(rng.uniform(-np.pi, np.pi)), uniform(rng, config.distance)
        place = objects[0].centre[:2] + distance * np.array([np.cos(direction), np.sin(direction)])
        return SceneObject(mesh, points, _resting(mesh, place, yaw, floor), yaw)

    def fits(drawn: SceneObject) -> bool:
        clear = (
            np.linalg.norm((drawn.centre - there.centre)[:2]) >= drawn.radius + there.radius + config.gap
            for there in objects
        )
        return bool(np.abs(drawn.vertices[:, :2]).max() <= 0.5 * floor.side) and all(clear)

    return draw_until(
        draw,
        fits,
        "a further object, on the floor and clear of the others,",
        "raise its distance or scene.floor.side, or lower its gap or scene.object.reach",
    )


def _resting(mesh: Mesh, place: FloatArray, yaw: float, floor: Floor) -> FloatArray:
    """(4, 4) object to world of a centred mesh that rests on the floor at (x, y)."""
    position = np.array([*place, floor.height + 0.5 * extents(mesh)[2]])
    return make_transform(rotations_about(WORLD_UP, np.array([yaw]))[0], position)
