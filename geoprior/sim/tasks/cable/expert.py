"""The scripted cable: take the plug, carry it over the area, down, open, up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.sim.experts.course import Course
from geoprior.sim.experts.grasp import CLOSING_TENTHS, nearest_yaw, yaw_of
from geoprior.sim.experts.path import Waypoint, hand_down

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.tasks.cable.world import CableWorld

TURN = np.radians(50.0)
"""By how much the hand turns the plug on its way, at most."""


def cable_expert(
    world: CableWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """One demonstration; see `geoprior.sim.tasks.task.Task.expert`.

    What varies: speed, yaw and height of the grasp, a few millimetres of aim at the plug and at the area,
    how high and by which way the plug is carried, how far it is turned, and the pauses.
    """
    course, speed = Course(world, start), rng.uniform(0.14, 0.19)
    yield from _take(course, world, speed, rng)
    yield from _carry(course, world, speed, rng)
    yield from _lay(course, world, speed, rng)
    yield from _leave(course, speed, rng)


def _take(
    course: Course, world: CableWorld, speed: float, rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """Over the plug, down, aim again, close: one finger on either side of the cable."""
    plug = world.transform_plug_to_workspace()
    along = float(np.arctan2(plug[1, 0], plug[0, 0]))
    yaw = nearest_yaw(along, 2, yaw_of(course.last), rng) + rng.uniform(-0.1, 0.1)
    down = hand_down(yaw)
    grasp = plug[:3, 3] + rng.uniform(-0.004, 0.008) * plug[:3, 0] + [0.0, 0.0, rng.uniform(0.004, 0.010)]
    above = grasp + np.array([*rng.normal(0.0, 0.005, 2), rng.uniform(0.08, 0.11)])
    yield from course.go(
        Waypoint(above, down, 0.0, speed), Waypoint(grasp, down, 0.0, speed * rng.uniform(0.5, 0.7))
    )
    yield from course.rest(patience=4)
    grasp = grasp + course.correction()
    yield from course.go(
        Waypoint(grasp, down, 0.0, speed, wait=int(rng.integers(0, 3))),
        Waypoint(grasp, down, 1.0, speed, wait=CLOSING_TENTHS),
    )


def _carry(
    course: Course, world: CableWorld, speed: float, rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """Up, and over the area by a way that bows to one side; the plug comes to point more along the way."""
    here, down = course.target(), Rotation.from_quat(course.last[3:7])
    way = np.array([*-world.plug_from_area()[:2], 0.0])
    turned = hand_down(yaw_of(course.last) + rng.uniform(0.5, 1.0) * _turn_to(way, world))
    sideways = rng.uniform(-0.15, 0.15) * np.array([-way[1], way[0], 0.0])
    up = np.array([0.0, 0.0, rng.uniform(0.05, 0.09)])
    yield from course.go(
        Waypoint(here + up, down, 1.0, 0.8 * speed),
        Waypoint(here + up + 0.5 * way + sideways, turned, 1.0, speed),
        Waypoint(here + up + way, turned, 1.0, speed * rng.uniform(0.8, 1.0)),
    )


def _turn_to(way: FloatArray, world: CableWorld) -> float:
    """Radians from the plug's x axis to a way (3,), `TURN` at most: what is behind it lies on its cable."""
    x, y, _ = world.transform_plug_to_workspace()[:3, :3].T @ way
    return float(np.clip(np.arctan2(y, x), -TURN, TURN))


def _lay(
    course: Course, world: CableWorld, speed: float, rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """Down to a little above and behind the aim, then ahead and onto it: the cable trails behind the plug.

    Both times by where the plug really is. At first the aim is mended by half: after the long way to the
    area the hand still swings.
    """
    aim, turned = rng.uniform(-0.008, 0.008, 2), Rotation.from_quat(course.last[3:7])
    behind, above = rng.uniform(0.015, 0.025, 2)
    stages = ((above, behind, 0.5, 0.5), (rng.uniform(0.0, 0.003), 0.0, 1.0, 0.3))
    for height, back, gain, share in stages:
        yield from course.rest(patience=8)
        ahead = world.transform_plug_to_workspace()[:2, 0]
        lacking = gain * (aim - world.plug_from_area()[:2]) - back * ahead
        target = course.target() + np.array([*lacking, height - world.plug_clearance()])
        yield from course.go(Waypoint(target, turned, 1.0, share * speed))
    yield from course.rest(patience=4)


def _leave(course: Course, speed: float, rng: np.random.Generator) -> Iterator[NDArray[np.float32]]:
    """Open, up, and stay."""
    here, down = course.target(), Rotation.from_quat(course.last[3:7])
    up = np.array([0.0, 0.0, rng.uniform(0.06, 0.09)])
    yield from course.go(
        Waypoint(here, down, 0.0, speed, wait=int(rng.integers(5, 8))),
        Waypoint(here + up, down, 0.0, 0.8 * speed, wait=int(rng.integers(5, 8))),
    )
