"""The scripted pick: over the cube, down, close, up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.sim.experts.path import Waypoint, follow, hand_down

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.sim.worlds.pick import PickWorld

CLOSING_STEPS = 13
"""Commands during which the hand waits for its fingers: robosuite closes by a fifth of half the way each."""


def pick_expert(
    world: PickWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """One demonstration; see `geoprior.sim.tasks.task.Task.expert`.

    What varies from one to the next: speed, height of the approach, height of the grasp, a few
    millimetres of aim, pauses, and which of the cube's four equivalent yaws is taken when two are close.
    """
    cube = world.cube_position()
    down = hand_down(_grasp_yaw(world.cube_yaw(), _yaw_of(start), rng))
    speed = rng.uniform(0.14, 0.20)
    above = cube + np.array([*rng.normal(0.0, 0.006, 2), rng.uniform(0.08, 0.12)])
    grasp = cube + np.array([*rng.uniform(-0.003, 0.003, 2), rng.uniform(-0.006, 0.004)])
    lifted = grasp + np.array([*rng.normal(0.0, 0.01, 2), rng.uniform(0.12, 0.17)])
    waypoints = [
        Waypoint(above, down, 0.0, speed),
        Waypoint(grasp, down, 0.0, speed * rng.uniform(0.5, 0.7), wait=int(rng.integers(1, 3))),
        Waypoint(grasp, down, 1.0, speed, wait=CLOSING_STEPS),
        Waypoint(lifted, down, 1.0, speed, wait=3),
    ]
    return follow(start, waypoints, world.control_freq)


def _grasp_yaw(cube_yaw: float, hand_yaw: float, rng: np.random.Generator) -> float:
    """The nearest of the four yaws, judged with an eye that errs by a few degrees."""
    turns = cube_yaw - hand_yaw + np.arange(4) * np.pi / 2.0
    turns = (turns + np.pi) % (2.0 * np.pi) - np.pi
    seen = turns + rng.normal(0.0, np.radians(5.0))
    return float(hand_yaw + turns[np.argmin(np.abs(seen))])


def _yaw_of(pose: NDArray[np.float32]) -> float:
    up = Rotation.from_quat(pose[3:7]).as_matrix()[:, 1]
    return float(np.arctan2(up[1], up[0]))
