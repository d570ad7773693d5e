"""How the experts take hold of a cube from above: what pick and place have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.sim.experts.path import Waypoint, hand_down

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.worlds.cube import CubeWorld

CLOSING_TENTHS = 13
"""Tenths of a second that the hand waits for its fingers: robosuite closes them by a fifth of half the way
with every command."""


@dataclass(frozen=True)
class Grasp:
    """A grasp that has been decided on.

    Attributes:
        above: (3,) where the hand goes first, workspace frame, metres.
        position: (3,) where it closes.
        rotation: Of the hand frame in the workspace frame, at both.
        speed: Mean speed of the demonstration's free motion, metres a second.
    """

    above: FloatArray
    position: FloatArray
    rotation: Rotation
    speed: float

    def waypoints(self, rng: np.random.Generator) -> list[Waypoint]:
        """Over the cube, down, close."""
        slow, wait = self.speed * rng.uniform(0.5, 0.7), int(rng.integers(1, 3))
        return [
            Waypoint(self.above, self.rotation, 0.0, self.speed),
            Waypoint(self.position, self.rotation, 0.0, slow, wait=wait),
            Waypoint(self.position, self.rotation, 1.0, self.speed, wait=CLOSING_TENTHS),
        ]


def draw_grasp(world: CubeWorld, start: NDArray[np.float32], rng: np.random.Generator) -> Grasp:
    """Decide how to grasp the cube where it lies now.

    What varies: speed, height of the approach, height of the grasp, a few millimetres of aim, and which of
    the cube's four equivalent yaws is taken when two are close.
    """
    cube = world.cube_position()
    rotation = hand_down(nearest_yaw(world.cube_yaw(), 4, yaw_of(start), rng))
    speed = rng.uniform(0.14, 0.20)
    above = cube + np.array([*rng.normal(0.0, 0.006, 2), rng.uniform(0.08, 0.12)])
    position = cube + np.array([*rng.uniform(-0.003, 0.003, 2), rng.uniform(-0.006, 0.004)])
    return Grasp(above, position, rotation, speed)


def nearest_yaw(yaw: float, symmetry: int, hand_yaw: float, rng: np.random.Generator) -> float:
    """The nearest of the equivalent yaws, judged with an eye that errs by a few degrees.

    Args:
        yaw: One of them, radians.
        symmetry: How many there are on a full turn.
        hand_yaw: The hand's yaw now, radians.
        rng: For the eye.
    """
    turns = yaw - hand_yaw + np.arange(symmetry) * 2.0 * np.pi / symmetry
    turns = (turns + np.pi) % (2.0 * np.pi) - np.pi
    seen = turns + rng.normal(0.0, np.radians(5.0))
    return float(hand_yaw + turns[np.argmin(np.abs(seen))])


def yaw_of(pose: NDArray[np.float32]) -> float:
    """The yaw of a pose vector (8,): of the hand's up axis about +z, from +x, radians."""
    up = Rotation.from_quat(pose[3:7]).as_matrix()[:, 1]
    return float(np.arctan2(up[1], up[0]))
