"""Aim error: where a predicted chunk leads, against where the object is, on unseen resets of a simulation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from geoprior.episode import POSE_SIZE, WORLD
from geoprior.errors import DataError, NumericalError
from geoprior.geometry.se3 import apply, invert
from geoprior.sim.workers import environment

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.policies.policy import Features, Predictor
    from geoprior.sim.environment import Environment
    from geoprior.sim.workers import Setup

    FloatArray = NDArray[np.float64]

FIRST_STATE = 4_000_000
"""Initial-state seeds from here on are kept for probes."""
OBJECT, CONTACT = "object", "contact"
"""Names of `geoprior.sim.worlds.tabletop.Tabletop.aim_points`."""
_BATCH = 32
_CM = 100.0


@dataclass(frozen=True)
class Resets:
    """What is seen at M initial states, and what there is to aim at.

    Attributes:
        pose: (M, 8 x hands) float32.
        images: Per camera (M, H, W, 3) uint8.
        points: Per name (M, 3), workspace frame, metres.
        places: Where each camera sees the object's centre, (M, 2) right and down of its frame, metres.
    """

    pose: NDArray[np.float32]
    images: Mapping[str, NDArray[np.uint8]]
    points: Mapping[str, FloatArray]
    places: Mapping[str, FloatArray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.pose)


def unseen_states(count: int, used: Iterable[range]) -> range:
    """``count`` initial-state seeds from `FIRST_STATE` on that lie in none of some ranges."""
    first = FIRST_STATE
    for states in sorted(used, key=lambda states: states.start):
        if states.start < first + count and states.stop > first:
            first = states.stop
    return range(first, first + count)


def see_resets(setup: Setup, control_rate: int, states: Sequence[int], features: Features) -> Resets | None:
    """Reset to every state and look; None where the task has no object to aim at.

    Raises:
        DataError: The policy moves other hands, looks through other cameras or at frames of another size.
        MachineError: No GL, or robosuite cannot be used.
        GeopriorError: The world cannot be built.
    """
    env = environment(setup, control_rate)
    seen = {camera.name: (camera.height, camera.width) for camera in env.camera_headers()}
    where = f"task {env.task.name!r} on robot {setup.robot.name!r}"
    require_the_same(where, "hands", features.hands, env.hands)
    require_the_same(where, "cameras", features.cameras, tuple(seen))
    require_the_same(where, "image size", features.image_size, next(iter(seen.values())))
    poses, images, points, places = [], [], [], []
    for state in states:
        env.reset(state)
        found = env.world.aim_points()
        if OBJECT not in found:
            return None
        observed = env.observe()
        poses.append(observed.pose)
        images.append(observed.images)
        points.append({name: np.array(point) for name, point in found.items()})
        places.append(_places(env, found[OBJECT]))
    return Resets(
        np.stack(poses),
        {name: np.stack([frames[name] for frames in images]) for name in features.cameras},
        {name: np.stack([each[name] for each in points]) for name in points[0]},
        {name: np.stack([each[name] for each in places]) for name in features.cameras},
    )


def _places(env: Environment, point: FloatArray) -> dict[str, FloatArray]:
    """(2,) of a point of the workspace in every camera's frame, right and down."""
    found = {}
    for camera in env.camera_headers():
        to_workspace = np.array(camera.transform_camera_to_mount)
        if camera.mount != WORLD:
            to_workspace = env.world.transform_hand_to_workspace(camera.mount) @ to_workspace
        found[camera.name] = apply(invert(to_workspace), point[None])[0, :2]
    return found


def require_the_same(where: str, what: str, wanted: object, found: object) -> None:
    """Refuse data that a policy was not trained for.

    Raises:
        DataError: They differ.
    """
    if wanted != found:
        raise DataError(
            f"{where}: key {what!r}: found {_told(found)}, and the checkpoint was trained on {_told(wanted)}",
            f"give data (--data) with the {what} of the checkpoint's training",
        )


def aim_error(predictor: Predictor, resets: Resets) -> dict[str, float]:
    """Distances in the table's plane, means over the resets, centimetres.

    ``true_cm`` is from the last position of the chunk that is predicted at the reset to the object;
    ``nearest_cm`` from whichever position of the chunk comes nearest, for chunks that lead on; ``still_cm``
    from where the hand is. With ``shuffled_cm`` and ``nearest_shuffled_cm`` the policy sees the images of
    another reset. Where there is a point of contact, ``contact_cm`` and ``contact_shuffled_cm`` are from the
    chunk's nearest position to that point. Of several hands the nearest one counts.

    Raises:
        NumericalError: The policy says numbers that are not finite.
    """
    others = np.roll(np.arange(len(resets)), -1)
    true, shuffled = _ways(predictor, resets, np.arange(len(resets))), _ways(predictor, resets, others)
    target = resets.points[OBJECT]
    start = resets.pose.astype(np.float64).reshape(len(resets), 1, -1, POSE_SIZE)[..., :2]
    found = {
        "true_cm": _distance(true[:, -1:], target),
        "shuffled_cm": _distance(shuffled[:, -1:], target),
        "nearest_cm": _distance(true, target),
        "nearest_shuffled_cm": _distance(shuffled, target),
        "still_cm": _distance(start, target),
    }
    if CONTACT in resets.points:
        contact = resets.points[CONTACT]
        found |= {
            "contact_cm": _distance(true, contact),
            "contact_shuffled_cm": _distance(shuffled, contact),
        }
    return found


def _ways(predictor: Predictor, resets: Resets, images: NDArray[np.int64]) -> FloatArray:
    """(M, chunk, hands, 2) where the hands are led, seeing the images of some resets."""
    parts = []
    for first in range(0, len(resets), _BATCH):
        rows = slice(first, first + _BATCH)
        seen = {name: frames[images[rows]] for name, frames in resets.images.items()}
        parts.append(predictor.predict(resets.pose[rows], seen))
    chunks = np.concatenate(parts).astype(np.float64)
    if not np.isfinite(chunks).all():
        raise NumericalError(
            "the policy says numbers that are not finite", "lower learning_rate and train again"
        )
    return chunks.reshape(*chunks.shape[:2], -1, POSE_SIZE)[..., :2]


def _distance(ways: FloatArray, points: FloatArray) -> float:
    """Mean of the least distance, centimetres, from ways (M, steps, hands, 2) to points (M, 3)."""
    apart = np.linalg.norm(ways - points[:, None, None, :2], axis=3)
    return float(_CM * apart.min(axis=(1, 2)).mean())


def _told(value: object) -> str:
    if not isinstance(value, tuple):
        return str(value)
    return (" x " if all(isinstance(each, int) for each in value) else ", ").join(map(str, value))
