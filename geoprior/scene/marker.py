"""The marker: where the object shall end, drawn on the floor as the object's top-down projection.

It may also be larger than what the object covers, and only a band, with or without walls: the goal is then
whatever lies on the floor beside the object, as an enclosure or a coloured area does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.projection import in_view
from geoprior.geometry.se3 import apply, make_transform
from geoprior.geometry.seeding import child
from geoprior.scene.mesh import Mesh, flat_hull, points_for_density, sample_surface
from geoprior.scene.ranges import uniform
from geoprior.scene.rejection import draw_until

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Marker:
    """The goal as it is drawn.

    Attributes:
        points: (M, 3) world, metres, all at the floor's height.
        surface: What renderers of solids draw; None for the hull of the points.
    """

    points: FloatArray
    surface: Mesh | None = None


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
        if scene.marker.size[1] > 1.0:
            footprint[:, :2] += (scene.marker.size[1] - 1.0) * (footprint[:, :2] - goal[:2, 3])
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


def draw_marker(scene: Scene, goal: FloatArray, rng: np.random.Generator, *, walls: bool = False) -> Marker:
    """Draw the marker as the scene's options say; see `marker_points` for the arguments.

    Args:
        scene: The scene.
        goal: (4, 4) transform object to world; see `draw_goal`.
        rng: Draws the points; size and shape come from a generator of their own.
        walls: Whether a band may have walls: not where the object is pushed over them.
    """
    config, own = scene.marker, child(rng, "marker")
    if config.size == (1.0, 1.0) and config.outline == 0.0:
        return Marker(marker_points(scene, goal, rng))
    factor, is_band = uniform(own, config.size), bool(own.random() < config.outline)
    width, height = uniform(own, config.band), uniform(own, config.wall) if walls else 0.0
    footprint = apply(goal, scene.object.mesh.vertices)
    footprint[:, 2] = scene.floor.height
    footprint[:, :2] = goal[:2, 3] + factor * (footprint[:, :2] - goal[:2, 3])
    whole = flat_hull(footprint)
    inner = 1.0 - 2.0 * width
    sheet = band(whole.vertices, inner, 0.0) if is_band else whole
    points = sample_surface(sheet, points_for_density(sheet, config.density), rng)
    points[:, 2] = scene.floor.height  # sampling rounds
    return Marker(points, band(whole.vertices, inner, height) if is_band and height else sheet)


def band(outline: FloatArray, inner: float, height: float) -> Mesh:
    """A band along a convex polygon, seen from above: a flat one, or one with walls on both sides.

    Args:
        outline: (K, 3) corners on the floor, counter-clockwise seen from above, metres.
        inner: Size of the empty middle, as a share of the whole.
        height: Of the walls, metres; 0 for a sheet on the floor.
    """
    middle = outline.mean(axis=0)
    up = np.array([0.0, 0.0, height])
    hole = middle + inner * (outline - middle)
    vertices = np.concatenate([outline + up, hole + up, outline, hole])
    count = len(outline)
    here = np.arange(count)
    ahead = np.roll(here, -1)
    top = _quads(here, ahead, count + ahead, count + here)
    if height == 0.0:
        return Mesh(vertices[: 2 * count], top)
    outer = _quads(2 * count + here, 2 * count + ahead, ahead, here)
    inside = _quads(3 * count + ahead, 3 * count + here, count + here, count + ahead)
    return Mesh(vertices, np.concatenate([top, outer, inside]))


def _quads(*corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """(2 K, 3) triangles of K quadrangles, whose corners go round counter-clockwise seen from outside."""
    a, b, c, d = corners
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
