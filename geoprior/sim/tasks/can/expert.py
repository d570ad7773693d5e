"""The scripted can: over the can, down about its body, aim again, close, up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from geoprior.sim.experts.course import Course
from geoprior.sim.experts.grasp import CLOSING_TENTHS, yaw_of
from geoprior.sim.experts.path import Waypoint, hand_down
from geoprior.sim.worlds.vessels import CAN_HEIGHT

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.sim.tasks.can.world import CanWorld

YAW_SPREAD = np.radians(25.0)
"""A can is round: the hand may take it in any yaw, and turns little from where it starts."""


def can_expert(
    world: CanWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """One demonstration; see `geoprior.sim.tasks.task.Task.expert`.

    The open hand is only some 15 mm wider than the can: over the can it rests, and aims again.

    What varies: speed, yaw, heights of approach, grasp and lift, a few millimetres of aim, where the can is
    lifted to, and the pauses.
    """
    course = Course(world, start)
    down = hand_down(yaw_of(start) + rng.uniform(-YAW_SPREAD, YAW_SPREAD))
    speed = rng.uniform(0.14, 0.20)
    grasp = world.can_position() + np.array([*rng.uniform(-0.002, 0.002, 2), rng.uniform(0.040, 0.055)])
    above = np.array([*grasp[:2], CAN_HEIGHT + rng.uniform(0.030, 0.055)])
    yield from course.go(Waypoint(above, down, 0.0, speed))
    yield from course.rest(patience=6)
    grasp[:2] += course.correction()[:2]
    lifted = grasp + np.array([*rng.normal(0.0, 0.01, 2), rng.uniform(0.11, 0.15)])
    yield from course.go(
        Waypoint(grasp, down, 0.0, speed * rng.uniform(0.4, 0.6), wait=int(rng.integers(1, 4))),
        Waypoint(grasp, down, 1.0, speed, wait=CLOSING_TENTHS),
        Waypoint(lifted, down, 1.0, speed, wait=int(rng.integers(3, 6))),
    )
