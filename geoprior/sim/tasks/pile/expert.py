"""The scripted pile: take the bottle by its body, over the can with it, aim, down, open, up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.sim.experts.course import Course
from geoprior.sim.experts.grasp import CLOSING_TENTHS, yaw_of
from geoprior.sim.experts.path import Waypoint, hand_down

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.sim.tasks.pile.world import PileWorld

YAW_SPREAD = np.radians(25.0)
"""A bottle is round: the hand may take it in any yaw, and turns little from where it starts."""


def pile_expert(
    world: PileWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """One demonstration; see `geoprior.sim.tasks.task.Task.expert`.

    What varies: speed, yaw, heights of approach, grasp, carrying and hovering, a few millimetres of aim at
    the bottle and at the can, and the pauses.
    """
    course = Course(world, start)
    down = hand_down(yaw_of(start) + rng.uniform(-YAW_SPREAD, YAW_SPREAD))
    speed = rng.uniform(0.14, 0.19)
    yield from _take(course, world, down, speed, rng)
    yield from _put(course, world, down, speed, rng)
    yield from _leave(course, down, speed, rng)


def _take(
    course: Course, world: PileWorld, down: Rotation, speed: float, rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """Over the bottle, down, aim again, close, up, over the can."""
    bottle = world.transform_object_to_workspace(world.bottle)[:3, 3]
    grasp = bottle + np.array([*rng.uniform(-0.003, 0.003, 2), rng.uniform(0.058, 0.070)])
    above = grasp + np.array([*rng.normal(0.0, 0.004, 2), rng.uniform(0.085, 0.105)])
    yield from course.go(
        Waypoint(above, down, 0.0, speed), Waypoint(grasp, down, 0.0, speed * rng.uniform(0.5, 0.7))
    )
    yield from course.rest(patience=5)
    grasp += course.correction()
    up = np.array([0.0, 0.0, rng.uniform(0.120, 0.135)])
    over = grasp - bottle + world.transform_object_to_workspace(world.can)[:3, 3]
    yield from course.go(
        Waypoint(grasp, down, 0.0, speed, wait=int(rng.integers(0, 3))),
        Waypoint(grasp, down, 1.0, speed, wait=CLOSING_TENTHS),
        Waypoint(grasp + up, down, 1.0, speed, wait=int(rng.integers(1, 3))),
        Waypoint(over + up, down, 1.0, 0.75 * speed),
    )


def _put(
    course: Course, world: PileWorld, down: Rotation, speed: float, rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """Down to just above the can and then onto it, each time by where the bottle really is.

    From up there the aim is mended by half: after the long way to the can the hand still swings.
    """
    aim = rng.uniform(-0.004, 0.004, 2)
    for height, gain, share in ((rng.uniform(0.010, 0.015), 0.5, 0.4), (0.0, 1.0, 0.25)):
        yield from course.rest(patience=10)
        lacking = np.array([*aim, height]) - world.bottle_over_can()
        target = course.target() + np.array([gain, gain, 1.0]) * lacking
        yield from course.go(Waypoint(target, down, 1.0, share * speed))
    yield from course.rest(patience=4)


def _leave(
    course: Course, down: Rotation, speed: float, rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """Open, up, and stay."""
    here, up = course.target(), np.array([0.0, 0.0, rng.uniform(0.07, 0.09)])
    yield from course.go(
        Waypoint(here, down, 0.0, speed, wait=int(rng.integers(6, 9))),
        Waypoint(here + up, down, 0.0, 0.8 * speed, wait=int(rng.integers(5, 8))),
    )
