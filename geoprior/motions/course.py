"""A course: the legs of a hand's way, each with its nominal time, shared out over an episode's steps.

Nominal times are those of demonstrations: so many metres a second, so many radians, so many seconds of
waiting for the fingers. An episode of N steps runs through them all, faster or slower as a whole, so that
within an episode the hand's speed is alike in all legs, whatever their lengths.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from geoprior.errors import ConfigError
from geoprior.geometry.interpolate import lerp, slerp
from geoprior.geometry.se3 import make_transform
from geoprior.motions.timing import eased
from geoprior.options import Options

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

SPEED = 0.17
"""Metres a second: the middle of the scripted demonstrations' free motion."""
TURNING_SPEED = 1.2
"""Radians a second, as theirs."""
CLOSING = 1.3
"""Seconds for which a hand waits for its fingers."""
_BRIEFEST = 0.1
"""Seconds of a leg, at least."""
_STEPS_A_LEG = 2


class CourseOptions(Options):
    """How the legs of a course differ in speed."""

    share: float = Field(1.0, ge=0.0, le=1.0, description="Share of the episodes that are planned like this.")
    pace: float = Field(
        0.3,
        ge=0.0,
        le=0.9,
        description="Each leg is faster or slower than its nominal speed by up to this share.",
    )


@dataclass(frozen=True)
class Leg:
    """A part of a hand's way.

    Attributes:
        phase: Name of its steps.
        way: Hand poses (K, 4, 4) to world for progress (K,) from 0 to 1.
        seconds: Nominal time.
        gripper: 0 open or 1 closed, throughout.
        fingers: How far the fingers are apart at its start and at its end; see `HandWay.openness`.
        carries: Whether the object moves with the hand.
    """

    phase: str
    way: Callable[[FloatArray], FloatArray]
    seconds: float
    gripper: float = 0.0
    fingers: tuple[float, float] = (1.0, 1.0)
    carries: bool = False


@dataclass(frozen=True)
class Run:
    """A course at N time steps.

    Attributes:
        transforms_hand_to_world: (N, 4, 4).
        gripper: (N,) 0 or 1.
        openness: (N,) see `HandWay.openness`.
        phases: N names.
        leg: (N,) number of each step's leg.
        progress: (N,) of that leg, from 0 to 1, eased.
    """

    transforms_hand_to_world: FloatArray
    gripper: FloatArray
    openness: FloatArray
    phases: tuple[str, ...]
    leg: NDArray[np.int64]
    progress: FloatArray


def moving(phase: str, start: FloatArray, end: FloatArray, speed: float = 1.0) -> Leg:
    """A leg in a straight line, turning the shortest way; ``speed`` is a share of `SPEED`."""

    def way(progress: FloatArray) -> FloatArray:
        rotations = slerp(start[:3, :3], end[:3, :3], progress)
        return make_transform(rotations, lerp(start[:3, 3], end[:3, 3], progress))

    angle = float(Rotation.from_matrix(start[:3, :3].T @ end[:3, :3]).magnitude())
    distance = float(np.linalg.norm(end[:3, 3] - start[:3, 3]))
    return Leg(phase, way, max(distance / (speed * SPEED), angle / TURNING_SPEED, _BRIEFEST))


def waiting(phase: str, pose: FloatArray, seconds: float) -> Leg:
    """A leg that stays at a pose (4, 4)."""
    return Leg(phase, lambda progress: np.repeat(pose[None], len(progress), axis=0), seconds)


def closed(leg: Leg, *, carries: bool = False) -> Leg:
    """The leg with closed fingers, perhaps on the object."""
    return replace(leg, gripper=1.0, fingers=(0.0, 0.0), carries=carries)


def paced(legs: Sequence[Leg], pace: float, rng: np.random.Generator) -> list[Leg]:
    """The legs, each faster or slower by up to ``pace``."""
    return [replace(leg, seconds=leg.seconds / (1.0 + rng.uniform(-pace, pace))) for leg in legs]


def run(motion: str, legs: Sequence[Leg], steps: int, ease: float) -> Run:
    """Share an episode's steps out among the legs of a course.

    Args:
        motion: Its name, for the message.
        legs: One at least.
        steps: N.
        ease: See `geoprior.motions.timing.EaseOptions`.

    Raises:
        ConfigError: There are too few steps.
    """
    if steps < _STEPS_A_LEG * len(legs):
        raise ConfigError(
            f"motion {motion!r}: {steps} steps are too few, it needs {_STEPS_A_LEG * len(legs)}",
            "raise generate.fps or generate.seconds",
        )
    seconds = np.array([leg.seconds for leg in legs])
    ends = np.cumsum(seconds)
    times = np.linspace(0.0, ends[-1], steps)
    leg = np.minimum(np.searchsorted(ends, times), len(legs) - 1)
    share = np.clip((times - (ends - seconds)[leg]) / seconds[leg], 0.0, 1.0)
    share[-1] = 1.0
    progress = eased(share, ease)
    poses = [each.way(progress[leg == number]) for number, each in enumerate(legs)]
    fingers = np.array([each.fingers for each in legs])[leg]
    return Run(
        transforms_hand_to_world=np.concatenate(poses),
        gripper=np.array([each.gripper for each in legs])[leg],
        openness=fingers[:, 0] + share * (fingers[:, 1] - fingers[:, 0]),
        phases=tuple(legs[number].phase for number in leg),
        leg=leg,
        progress=progress,
    )
