"""Which time step of which episode stands at which place of a training: a pure function."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.seeding import generator

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray


class SampleOrder:
    """The endless order of samples; epoch k holds every episode once, at a random time step.

    Args:
        seed: Of the training.
        lengths: Time steps of each episode.
        early: Of N time steps, the one at ``floor(N u ** early)`` is taken, u even in [0, 1): above 1, early
            ones come more often.
    """

    def __init__(self, seed: int, lengths: Sequence[int], early: float = 1.0) -> None:
        self._seed, self._early = seed, early
        self._lengths = np.asarray(lengths, dtype=np.int64)
        self._epoch = lru_cache(maxsize=2)(self._draw_epoch)

    def samples(self, first: int, count: int) -> NDArray[np.int64]:
        """The samples at the positions ``first .. first + count - 1``.

        Returns:
            (count, 2): episode and time step.
        """
        episodes = len(self._lengths)
        positions = np.arange(first, first + count)
        table = np.empty((count, 2), dtype=np.int64)
        for epoch in range(first // episodes, (first + count - 1) // episodes + 1):
            inside = positions // episodes == epoch
            table[inside] = self._epoch(epoch)[positions[inside] % episodes]
        return table

    def _draw_epoch(self, epoch: int) -> NDArray[np.int64]:
        rng = generator(self._seed, "order", epoch)
        episodes = rng.permutation(len(self._lengths))
        return np.stack([episodes, self._draw_steps(self._lengths[episodes], rng)], axis=1)

    def _draw_steps(self, lengths: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
        if self._early == 1.0:
            return rng.integers(lengths)
        return (lengths * rng.random(len(lengths)) ** self._early).astype(np.int64)


def steps_until(epoch: int, episodes: int, batch_size: int) -> int:
    """Optimiser steps until every sample of the first ``epoch`` epochs has been in a batch."""
    return -(-epoch * episodes // batch_size)
