"""A linear probe: how well the object's place can be read from what the visual trunk makes of an image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from geoprior.geometry.se3 import apply, invert, transforms_of_poses
from geoprior.policies.normalise import normalise_images
from geoprior.policies.predictor import stack_cameras
from geoprior.probe.ridge import cross_validated
from geoprior.shards.episode import POSE_SIZE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from torch import nn

    from geoprior.policies.policy import Features
    from geoprior.probe.aim import Resets
    from geoprior.probe.vision import VisionProbe
    from geoprior.training.machine import Machine

    FloatArray = NDArray[np.float64]

MOST_ROWS = 1_200
"""Moments that are used, at most: the regression is solved in them."""
_BATCH = 48
_CM = 100.0


def probe_episodes(policy: nn.Module, probe: VisionProbe, machine: Machine) -> dict[str, float] | None:
    """Errors on the moments of episodes whose object's place is known; see `errors_cm`.

    Returns:
        None where the place is not known or the policy gives no features of its trunk.
    """
    known, ask = probe.episodes.object_positions, getattr(policy, "trunk_features", None)
    if known is None or ask is None:
        return None
    rows = probe.rows
    parts = probe.each_batch(policy, machine, np.arange(len(rows)), lambda _, seen: ask(seen))
    times = rows.steps[:, 0].reshape(len(probe.episodes), -1)
    objects = np.concatenate([known(place, steps) for place, steps in enumerate(times)])
    poses = probe.episodes.source.poses
    pose = np.stack([poses[slot][step] for slot, step in zip(rows.slots, rows.steps[:, 0], strict=True)])
    return errors_cm(np.concatenate(parts), pose, objects, rows.episodes, probe.features)


def probe_resets(policy: nn.Module, resets: Resets, features: Features) -> dict[str, float] | None:
    """The same at the initial states of a simulation; float32, on a policy that is on the CPU.

    Returns:
        None where the policy gives no features of its trunk.
    """
    ask = getattr(policy.eval(), "trunk_features", None)
    if ask is None:
        return None
    parts = []
    for first in range(0, len(resets), _BATCH):
        frames = {name: images[first : first + _BATCH] for name, images in resets.images.items()}
        seen = normalise_images(torch.from_numpy(stack_cameras(frames, features.cameras)))
        parts.append(ask(seen).double().numpy())
    states = np.arange(len(resets))
    return errors_cm(np.concatenate(parts), resets.pose, resets.points["object"], states, features)


def errors_cm(
    trunk: FloatArray,
    pose: NDArray[np.float32],
    objects: FloatArray,
    episodes: NDArray[np.int64],
    features: Features,
) -> dict[str, float]:
    """Mean distance between where the object is and where a ridge reads it, by camera, centimetres.

    The place is that in the table's plane, x and y of the workspace; for a hand's camera it is that across
    the hand, right and up of the hand frame. Every place is read by a regression that was fitted on other
    episodes, a fifth of them at a time.

    Args:
        trunk: (M, cameras, F) features.
        pose: (M, 8 x hands) of the same moments.
        objects: (M, 3) the object's centre, workspace frame, metres.
        episodes: (M,) of which episode each moment is.
        features: Names of cameras and hands.
    """
    rows = _thinned(episodes)
    wanted = {name: _place(name, pose[rows], objects[rows], features.hands) for name in features.cameras}
    found = {}
    for camera, name in enumerate(features.cameras):
        read = cross_validated(trunk[rows, camera], wanted[name], episodes[rows])
        found[name] = float(_CM * np.linalg.norm(read - wanted[name], axis=1).mean())
    return found


def _place(camera: str, pose: NDArray[np.float32], objects: FloatArray, hands: Sequence[str]) -> FloatArray:
    """(M, 2) what the camera shall tell, metres."""
    if camera not in hands:
        return objects[:, :2]
    hand = list(hands).index(camera) * POSE_SIZE
    to_hand = invert(transforms_of_poses(pose[:, hand : hand + POSE_SIZE]))
    return np.asarray(apply(to_hand, objects[:, None])[:, 0, :2])


def _thinned(episodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows of as many whole episodes as `MOST_ROWS` allows, evenly spread."""
    names, sizes = np.unique(episodes, return_counts=True)
    most = max(2, int(MOST_ROWS // sizes.mean()))
    kept = names[np.linspace(0, len(names) - 1, min(most, len(names))).astype(np.int64)]
    return np.flatnonzero(np.isin(episodes, kept))
