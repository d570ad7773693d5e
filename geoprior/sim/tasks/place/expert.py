"""The scripted place: grasp the cube, over the wall with it, aim, down, open, up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from geoprior.sim.experts.course import Course
from geoprior.sim.experts.grasp import draw_grasp
from geoprior.sim.experts.path import Waypoint

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.sim.tasks.place.world import PlaceWorld


def place_expert(
    world: PlaceWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """One demonstration; see `geoprior.sim.tasks.task.Task.expert`.

    What varies from one to the next, beside the grasp: the height at which the cube is carried, where in
    the enclosure and from how high it is let go, and the pauses.
    """
    course, grasp = Course(world, start), draw_grasp(world, start, rng)
    down, speed = grasp.rotation, grasp.speed
    way = (world.transform_goal_to_workspace()[:3, 3] - world.cube_position())[:2]
    over = grasp.position[:2] + way + rng.normal(0.0, 0.004, 2)
    carried = grasp.position[2] + rng.uniform(0.06, 0.09)
    released = grasp.position[2] + rng.uniform(0.005, 0.015)
    yield from course.go(
        *grasp.waypoints(rng),
        Waypoint(np.array([*grasp.position[:2], carried]), down, 1.0, speed),
        Waypoint(np.array([*over, carried]), down, 1.0, speed * rng.uniform(0.8, 1.0)),
    )
    yield from course.rest(patience=8)
    over += course.correction()[:2]
    low = np.array([*over, released])
    yield from course.go(Waypoint(low, down, 1.0, speed * rng.uniform(0.5, 0.7)))
    yield from course.rest(patience=3)
    yield from course.go(
        Waypoint(low, down, 0.0, speed, wait=int(rng.integers(5, 8))),
        Waypoint(np.array([*over, carried]), down, 0.0, speed),
    )
