"""The scripted push: with closed fingers down behind the cube, and straight to the area."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.sim.experts.course import Course
from geoprior.sim.experts.grasp import nearest_yaw, yaw_of
from geoprior.sim.experts.path import Waypoint, hand_down
from geoprior.sim.worlds.cube import CUBE_HALF_SIZE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.tasks.push.world import PushWorld

CLOSED = 1.0
CORNER = np.sqrt(2.0) * CUBE_HALF_SIZE
"""Metres from the cube's centre to a vertical edge: it reaches no farther towards the hand in any yaw."""


@dataclass(frozen=True)
class Stroke:
    """One straight push.

    Attributes:
        behind: (3,) where the hand comes down, workspace frame, metres.
        end: (3,) where it stops.
        rotation: Of the hand frame in the workspace frame, throughout.
    """

    behind: FloatArray
    end: FloatArray
    rotation: Rotation


def push_expert(
    world: PushWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """One demonstration; see `geoprior.sim.tasks.task.Task.expert`.

    A cube that has slid off the fingers to the side is pushed once more, from where it lies then.

    What varies: speed, height of the approach, height and aim of the push, how far behind the cube the hand
    comes down, where on the area the cube shall stop, and the pauses.
    """
    course, speed = Course(world, start), rng.uniform(0.14, 0.20)
    yield from _push(course, _plan(world, course.last, rng), speed, rng)
    if world.cube_over_area():
        return
    here, down = course.last[:3].astype(np.float64), Rotation.from_quat(course.last[3:7])
    yield from course.go(Waypoint(here + np.array([0.0, 0.0, 0.08]), down, CLOSED, speed))
    yield from _push(course, _plan(world, course.last, rng), speed, rng)


def _plan(world: PushWorld, hand: NDArray[np.float32], rng: np.random.Generator) -> Stroke:
    """From behind the cube, as it lies now, to the area.

    The hand points straight down and the fingers' broad side pushes: on a narrow one the cube turns and
    slides off. Where that side is across the hand's up axis, up points ahead, which is the paper's
    orientation of the pushing hand pitched down by a quarter turn, and the hand's camera looks at the cube
    and the area.
    """
    right, up, reach = world.robot.closed_fingers
    cube, goal = world.cube_position()[:2], world.transform_goal_to_workspace()[:2, 3]
    goal = goal + rng.normal(0.0, 0.004, 2)
    heading = float(np.arctan2(*(goal - cube)[::-1]))
    yaw = heading if right > up else nearest_yaw(heading + np.pi / 2.0, 2, yaw_of(hand), rng)
    ahead, half = np.array([np.cos(heading), np.sin(heading)]), 0.5 * min(right, up)
    aim, height = rng.uniform(-0.003, 0.003, 2), reach + rng.uniform(0.008, 0.012)
    behind = cube - (CORNER + half + rng.uniform(0.006, 0.014)) * ahead + aim
    end = goal - (CUBE_HALF_SIZE + half) * ahead + aim
    return Stroke(np.array([*behind, height]), np.array([*end, height]), hand_down(yaw))


def _push(
    course: Course, stroke: Stroke, speed: float, rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """Over the point behind the cube, down, to the end, and stay until everything is at rest."""
    down = stroke.rotation
    above = stroke.behind + np.array([*rng.normal(0.0, 0.006, 2), rng.uniform(0.06, 0.09)])
    yield from course.go(Waypoint(above, down, CLOSED, speed))
    yield from course.rest(patience=4)
    yield from course.go(Waypoint(stroke.behind, down, CLOSED, speed * rng.uniform(0.5, 0.7)))
    yield from course.rest(patience=5)
    end = stroke.end + course.correction()
    yield from course.go(Waypoint(end, down, CLOSED, speed * rng.uniform(0.4, 0.6)))
    yield from course.rest(patience=8)
    yield from course.go(Waypoint(end, down, CLOSED, speed, wait=int(rng.integers(2, 5))))
