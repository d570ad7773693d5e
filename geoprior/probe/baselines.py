"""What a prediction is worth nothing without: standing still, and a regression on the pose alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.probe.ridge import LinearMap, fit_ridge, folds
from geoprior.training.data import chunk_steps

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.policies.normalise import Normaliser
    from geoprior.probe.episodes import ProbeEpisodes, Rows

    FloatArray = NDArray[np.float64]

MOST_ROWS = 8_000
"""Moments that the regression is fitted on, at most."""


@dataclass(frozen=True)
class Lessons:
    """Moments to fit a pose-only regressor on, normalised.

    Attributes:
        pose: (M, pose_size).
        action: (M, chunk, pose_size).
        valid: (M, chunk) whether an action lies within its episode.
    """

    pose: FloatArray
    action: FloatArray
    valid: NDArray[np.bool_]

    def at(self, rows: NDArray[np.bool_]) -> Lessons:
        """Some of the moments."""
        return Lessons(self.pose[rows], self.action[rows], self.valid[rows])


def lessons_of(
    poses: Sequence[NDArray[np.float32]],
    actions: Sequence[NDArray[np.float32]],
    normaliser: Normaliser,
    chunk: int,
    skip: int,
) -> Lessons:
    """Moments of some episodes, each (N, pose_size): evenly spread, `MOST_ROWS` of them at most."""
    lengths = np.array([len(pose) for pose in poses])
    starts = np.cumsum(lengths) - lengths
    count = min(MOST_ROWS, int(lengths.sum()))
    chosen = np.linspace(0, lengths.sum() - 1, count).astype(np.int64)
    episodes = np.searchsorted(starts, chosen, side="right") - 1
    steps, valid = chunk_steps(chosen - starts[episodes], lengths[episodes], chunk, skip)
    pairs = list(zip(episodes.tolist(), steps, strict=True))
    pose = np.stack([poses[episode][row[0]] for episode, row in pairs])
    action = np.stack([actions[episode][row[1:]] for episode, row in pairs])
    return Lessons(
        normaliser.normalise("pose", pose).astype(np.float64),
        normaliser.normalise_actions(pose, action).astype(np.float64),
        valid,
    )


def lessons_of_rows(episodes: ProbeEpisodes, rows: Rows, normaliser: Normaliser) -> Lessons:
    """The moments that are measured on."""
    source, slots = episodes.source, rows.slots.tolist()
    pose = np.stack([source.poses[slot][row[0]] for slot, row in zip(slots, rows.steps, strict=True)])
    action = np.stack([source.actions[slot][row[1:]] for slot, row in zip(slots, rows.steps, strict=True)])
    return Lessons(
        normaliser.normalise("pose", pose).astype(np.float64),
        normaliser.normalise_actions(pose, action).astype(np.float64),
        rows.valid,
    )


def stand_still(episodes: ProbeEpisodes, rows: Rows, normaliser: Normaliser) -> FloatArray:
    """(M, 1, pose_size) the present pose as a command, gripper included, normalised as actions are."""
    slots = rows.slots.tolist()
    pose = np.stack(
        [episodes.source.poses[slot][row[0]] for slot, row in zip(slots, rows.steps, strict=True)]
    )
    return normaliser.normalise_actions(pose, pose[:, None]).astype(np.float64)


def fit_pose_only(lessons: Lessons) -> list[LinearMap]:
    """A ridge regression from the pose and its products to each action of the chunk.

    Each is fitted on the moments in which that action is valid; one that never is gives the pose's mean.
    """
    x = quadratic(lessons.pose)
    maps = []
    for place in range(lessons.action.shape[1]):
        valid = lessons.valid[:, place]
        known = valid if valid.any() else np.ones_like(valid)
        maps.append(fit_ridge(x[known], lessons.action[known, place]))
    return maps


def predict_pose_only(maps: Sequence[LinearMap], pose: FloatArray) -> FloatArray:
    """(M, pose_size) normalised poses to (M, chunk, pose_size) normalised actions."""
    x = quadratic(pose)
    return np.stack([one(x) for one in maps], axis=1)


def predict_by_others(asked: Lessons, episodes: NDArray[np.int64]) -> FloatArray:
    """`predict_pose_only` of each episode's moments, fitted on those of other episodes."""
    predicted = np.empty_like(asked.action)
    for held in folds(episodes):
        predicted[held] = predict_pose_only(fit_pose_only(asked.at(~held)), asked.pose[held])
    return predicted


def quadratic(pose: FloatArray) -> FloatArray:
    """(M, P) numbers to them and all their products of two, (M, P + P (P + 1) / 2)."""
    first, second = np.triu_indices(pose.shape[1])
    return np.hstack([pose, pose[:, first] * pose[:, second]])
