"""Paths of the hand through waypoints, with a smooth start and stop at each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from geoprior.geometry.se3 import REFERENCE_QUATERNION, continuous_quaternions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

AT_ONCE = np.inf
"""Metres a second: a segment of one command."""

TURNING_SPEED = 1.2
"""Radians a second, the mean over a segment."""

TENTHS = 10
"""In a second: the unit in which experts wait, whatever the rate of commands."""


@dataclass(frozen=True)
class Waypoint:
    """Where the hand goes next.

    Attributes:
        position: (3,) workspace frame, metres.
        rotation: Of the hand frame in the workspace frame.
        gripper: 0 or 1, from the segment's first command on.
        speed: Mean speed of the segment, metres a second.
        wait: Tenths of a second for which the hand stays once it is there.
    """

    position: FloatArray
    rotation: Rotation
    gripper: float
    speed: float
    wait: int = 0


def follow(
    start: NDArray[np.float32], waypoints: Sequence[Waypoint], control_rate: int
) -> Iterator[NDArray[np.float32]]:
    """Pose commands (8,) float32 along straight segments with minimum-jerk timing.

    Args:
        start: (8,) pose vector to begin at.
        waypoints: In order.
        control_rate: Commands a second.
    """
    position, rotation = start[:3].astype(np.float64), Rotation.from_quat(start[3:7])
    quaternion = start[3:7].astype(np.float64)
    for waypoint in waypoints:
        for share in _shares(position, rotation, waypoint, control_rate):
            place = position + share * (waypoint.position - position)
            turn = Slerp([0.0, 1.0], Rotation.concatenate([rotation, waypoint.rotation]))(share)
            quaternion = continuous_quaternions(turn.as_quat()[None], quaternion)[0]
            yield np.array([*place, *quaternion, waypoint.gripper], dtype=np.float32)
        position, rotation = waypoint.position, waypoint.rotation


def _shares(
    position: FloatArray, rotation: Rotation, waypoint: Waypoint, control_rate: int
) -> Iterator[float]:
    distance = float(np.linalg.norm(waypoint.position - position))
    angle = float((waypoint.rotation * rotation.inv()).magnitude())
    seconds = max(distance / waypoint.speed, angle / TURNING_SPEED)
    steps = max(1, round(seconds * control_rate))
    for step in range(1, steps + 1):
        yield eased(step / steps)
    for _ in range(commands_in(waypoint.wait, control_rate)):
        yield 1.0


def commands_in(tenths: int, control_rate: int) -> int:
    """How many commands are given in so many tenths of a second, and no fewer than one in each.

    Fingers close by a part of their way with every command, so that at a low rate they need longer.
    """
    return max(tenths, round(tenths * control_rate / TENTHS))


def eased(time: float) -> float:
    """Minimum-jerk timing (Flash and Hogan 1985) from 0 to 1."""
    return time**3 * (10.0 - 15.0 * time + 6.0 * time**2)


def hand_down(yaw: float) -> Rotation:
    """The hand that points straight down, its up axis turned by ``yaw`` radians from +x about +z."""
    return Rotation.from_euler("z", yaw) * Rotation.from_quat(REFERENCE_QUATERNION)
