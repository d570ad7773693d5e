"""From predicted chunks to one command a step: temporal ensembling, or chunks carried out open-loop."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from geoprior.episode import POSE_SIZE

if TYPE_CHECKING:
    from numpy.typing import NDArray

GRIPPER_THRESHOLD = 0.5


def blend(predictions: NDArray[np.float32], coefficient: float) -> NDArray[np.float32]:
    """One command for each hand from several predictions of it.

    The weights are those of ACT (Zhao et al. 2023, section IV-B): ``exp(-coefficient * i)``, ``i = 0`` for
    the oldest prediction. Positions are averaged. Quaternions are first given the sign that puts them on the
    oldest one's hemisphere, then averaged and normalised: for rotations as close as predictions of one
    command are, this is the chordal mean. The gripper is averaged and then closed from `GRIPPER_THRESHOLD`
    on, so that it stays a step: a majority of the weight decides.

    Args:
        predictions: (P, 8 x hands) pose vectors, the oldest first.
        coefficient: ``m``; 0 gives equal weights, above 0 the older ones weigh more.

    Returns:
        (8 x hands) pose vectors, grippers 0 or 1.
    """
    weights = np.exp(-coefficient * np.arange(len(predictions)))
    weights /= weights.sum()
    hands = range(0, predictions.shape[1], POSE_SIZE)
    blended = [_blend_hand(predictions[:, first : first + POSE_SIZE], weights) for first in hands]
    return np.concatenate(blended)


def _blend_hand(predictions: NDArray[np.float32], weights: NDArray[np.float64]) -> NDArray[np.float32]:
    """One hand's command (8,) from predictions (P, 8)."""
    rows = predictions.astype(np.float64, order="C")
    flips = np.where(rows[:, 3:7] @ rows[0, 3:7] < 0.0, -1.0, 1.0)
    rows[:, 3:7] *= flips[:, None]
    command = weights @ rows
    norm = np.linalg.norm(command[3:7])
    if norm > 0.0:
        command[3:7] /= norm
    command[7] = float(command[7] >= GRIPPER_THRESHOLD)
    return np.asarray(command, dtype=np.float32)


class TemporalEnsemble:
    """Looks at every step, and blends all predictions of the present step.

    Args:
        coefficient: See `blend`.
    """

    def __init__(self, coefficient: float) -> None:
        self._coefficient = coefficient
        self._chunks: deque[tuple[int, NDArray[np.float32]]] = deque()

    def wants_chunk(self, step: int) -> bool:  # noqa: ARG002 - the other strategy needs the step
        """True: every step brings a new chunk."""
        return True

    def add(self, step: int, chunk: NDArray[np.float32]) -> None:
        """Take the chunk (K, 8 x hands) predicted at a step; its first row is that step's command."""
        self._chunks.append((step, chunk))

    def command(self, step: int) -> NDArray[np.float32]:
        """The command (8 x hands) of a step, not before the latest chunk's."""
        while self._chunks[0][0] + len(self._chunks[0][1]) <= step:
            self._chunks.popleft()
        return blend(np.stack([chunk[step - begun] for begun, chunk in self._chunks]), self._coefficient)


class OpenLoop:
    """Looks now and then, and carries out the beginning of each chunk as it is.

    Args:
        execute: Actions of a chunk before the next look; a shorter chunk is used whole.
    """

    def __init__(self, execute: int) -> None:
        self._execute = execute
        self._begun = 0
        self._chunk: NDArray[np.float32] | None = None

    def wants_chunk(self, step: int) -> bool:
        """Whether the present chunk is used up."""
        return self._chunk is None or step - self._begun >= min(self._execute, len(self._chunk))

    def add(self, step: int, chunk: NDArray[np.float32]) -> None:
        """Take the chunk (K, 8 x hands) predicted at a step."""
        self._begun, self._chunk = step, chunk

    def command(self, step: int) -> NDArray[np.float32]:
        """The command (8 x hands) of a step."""
        assert self._chunk is not None, "add a chunk first"
        return np.asarray(self._chunk[step - self._begun])
