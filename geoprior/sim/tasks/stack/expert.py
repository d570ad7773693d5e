"""The scripted stack: grasp the cube, over the base with it, aim, down, open, up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from geoprior.sim.experts.course import Course
from geoprior.sim.experts.grasp import Grasp, draw_grasp
from geoprior.sim.experts.path import Waypoint

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.sim.tasks.stack.world import StackWorld


def stack_expert(
    world: StackWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """One demonstration; see `geoprior.sim.tasks.task.Task.expert`.

    What varies from one to the next, beside the grasp: the height at which the cube is carried, where on
    the base it comes to lie, and the pauses.
    """
    course, grasp = Course(world, start), draw_grasp(world, start, rng)
    up = np.array([0.0, 0.0, rng.uniform(0.085, 0.110)])
    over = world.base_position() - world.cube_position() + grasp.position
    yield from course.go(
        *grasp.waypoints(rng),
        Waypoint(grasp.position + up, grasp.rotation, 1.0, grasp.speed, wait=int(rng.integers(0, 3))),
        Waypoint(over + up, grasp.rotation, 1.0, grasp.speed * rng.uniform(0.7, 0.9)),
    )
    yield from _put(course, world, grasp, rng)
    yield from _leave(course, grasp, rng)


def _put(
    course: Course, world: StackWorld, grasp: Grasp, rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """Down to just above the base and then onto it, each time by where the cube really is.

    From up there the aim is mended by half: after the long way to the base the hand still swings.
    """
    aim = rng.uniform(-0.004, 0.004, 2)
    for height, gain, share in ((rng.uniform(0.010, 0.016), 0.5, 0.5), (0.001, 1.0, 0.25)):
        yield from course.rest(patience=8)
        lacking = np.array([*aim, height]) - world.cube_over_base()
        target = course.target() + np.array([gain, gain, 1.0]) * lacking
        yield from course.go(Waypoint(target, grasp.rotation, 1.0, share * grasp.speed))
    yield from course.rest(patience=4)


def _leave(course: Course, grasp: Grasp, rng: np.random.Generator) -> Iterator[NDArray[np.float32]]:
    """Open, up, and stay."""
    here, up = course.target(), np.array([0.0, 0.0, rng.uniform(0.07, 0.09)])
    yield from course.go(
        Waypoint(here, grasp.rotation, 0.0, grasp.speed, wait=int(rng.integers(5, 8))),
        Waypoint(here + up, grasp.rotation, 0.0, 0.8 * grasp.speed, wait=int(rng.integers(5, 8))),
    )
