"""Solids that have nothing to do with what happens: they lie on the floor, out of everything's way.

They lie farther from the workspace's middle than objects do, so that which solid is meant stays clear.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.se3 import apply
from geoprior.scene.mesh import Mesh, extents
from geoprior.scene.objects import SceneObject, rest_object
from geoprior.scene.ranges import uniform

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from geoprior.motions.trajectory import Trajectory
    from geoprior.scene.config import DistractorsConfig
    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]

_ATTEMPTS = 30


def draw_distractors(
    config: DistractorsConfig,
    density: float,
    scene: Scene,
    trajectory: Trajectory,
    solid: Callable[[], Mesh],
    rng: np.random.Generator,
) -> tuple[SceneObject, ...]:
    """Strew solids on the floor; one that finds no room is left out.

    Args:
        config: How many, and where.
        density: Of their points; see `ObjectConfig`.
        scene: What is there.
        trajectory: What happens; nothing of it comes nearer than the config's gap.
        solid: Draws one.
        rng: Draws the places.
    """
    there: list[SceneObject] = []
    taken = _taken(scene, trajectory)
    for _ in range(int(rng.integers(*config.count, endpoint=True))):
        mesh = solid()
        found = _placed(config, density, scene, mesh, [taken, *map(_circle, there)], rng)
        there += [found] if found else []
    return tuple(there)


def _placed(
    config: DistractorsConfig,
    density: float,
    scene: Scene,
    mesh: Mesh,
    taken: Sequence[FloatArray],
    rng: np.random.Generator,
) -> SceneObject | None:
    circles = np.concatenate(taken)
    for _ in range(_ATTEMPTS):
        direction, distance = rng.uniform(-np.pi, np.pi), uniform(rng, config.distance)
        place = distance * np.array([np.cos(direction), np.sin(direction)])
        found = rest_object(mesh, density, place, scene.floor, rng)
        apart = np.linalg.norm(circles[:, :2] - place, axis=1) - circles[:, 2] - found.radius
        on_floor = np.abs(found.vertices[:, :2]).max() <= 0.5 * scene.floor.side
        if on_floor and apart.min() >= config.gap:
            return found
    return None


def _circle(there: SceneObject) -> FloatArray:
    return np.array([[*there.centre[:2], there.radius]])


def _taken(scene: Scene, trajectory: Trajectory) -> FloatArray:
    """Circles (K, 3) as x, y and radius, seen from above, in which something is or happens."""
    ways = [(each.radius, each.transform_object_to_world[None]) for each in scene.others.values()]
    ways.append((scene.object.radius, trajectory.transforms_object_to_world))
    for name, hand in scene.hands.items():
        corners = np.vstack(
            [each.vertices for each in hand.solids(hand.fingers.opening if hand.fingers else 0)]
        )
        way = trajectory.hands[name].transforms_hand_to_world
        low = way[apply(way, corners[None])[..., 2].min(axis=1) < scene.floor.height + _tallest(scene)]
        ways.append((float(np.linalg.norm(corners[:, :2], axis=1).max()), low))
    circles = [np.column_stack([way[:, :2, 3], np.full(len(way), radius)]) for radius, way in ways]
    if trajectory.marker_points is not None:
        circles.append(
            np.column_stack([trajectory.marker_points[:, :2], np.zeros(len(trajectory.marker_points))])
        )
    return np.concatenate(circles)


def _tallest(scene: Scene) -> float:
    return 2.0 * float(extents(scene.object.mesh)[2]) + 0.1
