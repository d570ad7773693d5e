"""The scripted door: in front of the handle, to it, close, pull along an arc about the hinge."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.sim.experts.course import Course
from geoprior.sim.experts.grasp import CLOSING_TENTHS
from geoprior.sim.experts.path import AT_ONCE, Waypoint, eased, hand_down

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.tasks.door.world import DoorWorld


LARGEST = 0.006
"""Metres: the longest correction of an aim."""


def door_expert(
    world: DoorWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """One demonstration; see `geoprior.sim.tasks.task.Task.expert`.

    The hand comes to the handle at a slant, its fingers above and below the bar.

    What varies: speed, slant, from how far the hand comes, a few millimetres of aim, how far and how fast
    the door is pulled, and the pauses.
    """
    course = Course(world, start)
    yield from _grasp(course, world, rng)
    yield from course.go(*_arc(course.last, world, rng))
    yield from course.rest(patience=int(rng.integers(5, 9)))


def _grasp(course: Course, world: DoorWorld, rng: np.random.Generator) -> Iterator[NDArray[np.float32]]:
    """In front of the handle, to it, aim again, close."""
    handle = world.transform_handle_to_workspace()
    rotation = _slanted(handle, rng.uniform(np.radians(24.0), np.radians(36.0)))
    forward = rotation.as_matrix()[:, 2]
    speed = rng.uniform(0.10, 0.14)
    grasp = handle[:3, 3] + rng.uniform(0.002, 0.008) * handle[:3, 0] + rng.uniform(-0.002, 0.004) * forward
    yield from course.go(Waypoint(grasp - rng.uniform(0.12, 0.15) * forward, rotation, 0.0, speed))
    yield from course.rest(patience=8)
    yield from course.go(
        Waypoint(grasp + _limited(course.correction()), rotation, 0.0, speed * rng.uniform(0.4, 0.55))
    )
    yield from course.rest(patience=8)
    grasp += _limited(course.correction())
    yield from course.go(
        Waypoint(grasp, rotation, 0.0, speed, wait=int(rng.integers(0, 3))),
        Waypoint(grasp, rotation, 1.0, speed, wait=CLOSING_TENTHS),
    )


def _arc(last: NDArray[np.float32], world: DoorWorld, rng: np.random.Generator) -> list[Waypoint]:
    """The pull: one waypoint a command, all at the hand's present distance from the hinge."""
    hinge, angle = world.hinge_position(), rng.uniform(0.42, 0.55)
    steps = round(angle / rng.uniform(0.20, 0.28) * world.control_freq)
    rotation, arm = Rotation.from_quat(last[3:7]), last[:3] - hinge
    turns = [Rotation.from_euler("z", angle * eased(step / steps)) for step in range(1, steps + 1)]
    return [Waypoint(hinge + turn.apply(arm), turn * rotation, 1.0, AT_ONCE) for turn in turns]


def _slanted(handle: FloatArray, slant: float) -> Rotation:
    """The hand that points at the panel and down, its fingers above and below the bar.

    Args:
        handle: (4, 4) transform of the handle to the workspace.
        slant: Radians off the vertical.
    """
    bar = handle[:3, 0]
    yaw = float(np.arctan2(-bar[1], -bar[0]))
    return Rotation.from_euler("z", yaw) * Rotation.from_euler("x", -slant) * hand_down(0.0)


def _limited(correction: FloatArray) -> FloatArray:
    """No longer than `LARGEST`: a lack of centimetres is a swing of the arm, and soon over."""
    return correction * min(1.0, LARGEST / max(float(np.linalg.norm(correction)), LARGEST))
