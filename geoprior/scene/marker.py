"""The marker: where the object shall end, drawn on the floor as the object's top-down projection."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.projection import in_view
from geoprior.geometry.se3 import apply, make_transform
from geoprior.scene.mesh import points_for_density, sample_surface
from geoprior.scene.ranges import uniform
from geoprior.scene.rejection import draw_until

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]


def draw_goal(scene: Scene, rotation: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw where the object shall rest: turned by ``rotation``, wholly on the floor, in the third view.

    Args:
        scene: The scene.
        rotation: (3, 3) turn of the object about world z from its start: R_rand of a place, the identity of
            a push.
        rng: Draws direction and distance.

    Returns:
        (4, 4) the goal's transform object to world. Its position is the paper's c_mark lifted to the centre
        of the resting object.

    Raises:
        ConfigError: There is no room for it.
    """
    start = scene.object.transform_object_to_world
    turned = rotation @ start[:3, :3]

    def draw() -> FloatArray:
        direction = float(rng.uniform(-np.pi, np.pi))
        distance = uniform(rng, scene.marker.distance)
        step = distance * np.array([np.cos(direction), np.sin(direction), 0.0])
        return make_transform(turned, start[:3, 3] + step)

    def fits(goal: FloatArray) -> bool:
        footprint = apply(goal, scene.object.mesh.vertices)
        footprint[:, 2] = scene.floor.height
        on_floor = np.abs(footprint[:, :2]).max() <= 0.5 * scene.floor.side
        return bool(on_floor) and in_view(scene.third_view, footprint, scene.margin)

    return draw_until(
        draw,
        fits,
        "a marker on the floor and in the third-person view",
        "lower scene.marker.distance or scene.object.reach, or raise scene.floor.side",
    )


def marker_points(scene: Scene, goal: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw the marker: fresh surface points of the object at its goal, projected down onto the floor.

    Args:
        scene: The scene.
        goal: (4, 4) transform object to world; see `draw_goal`.
        rng: Draws the points.

    Returns:
        (M, 3) world, metres, all at the floor's height.
    """
    mesh = scene.object.mesh
    points = apply(goal, sample_surface(mesh, points_for_density(mesh, scene.marker.density), rng))
    points[:, 2] = scene.floor.height
    return points
