"""The loss on episodes that a training never sees."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
import torch

from geoprior.policies.predictor import stack_cameras
from geoprior.training.data import chunk_steps, make_batch

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import nn

    from geoprior.policies.normalise import Normaliser
    from geoprior.policies.policy import Batch, Features, Policy
    from geoprior.sources.source import Moments, Source
    from geoprior.training.config import TrainConfig
    from geoprior.training.machine import Machine

PREFIX = "held_out_"
MOMENTS = 4
"""Time steps of each episode, evenly spread."""

_SEED = 0
"""What a policy draws in its loss is the same at every checkpoint."""


class HeldOut:
    """Judges a policy by moments of held-out episodes, without noise, shifts or dropout.

    Args:
        source: Where the episodes come from; those of its first epoch are taken.
        slots: Of the held-out episodes.
        features: Chunk and cameras.
        normaliser: Of the training.
        config: Batch size and skip.
        read: Takes the place of the source's, which a training's loader may be calling meanwhile.
    """

    def __init__(
        self,
        source: Source,
        slots: Sequence[int],
        features: Features,
        normaliser: Normaliser,
        config: TrainConfig,
        read: Callable[[NDArray[np.int64], NDArray[np.int64]], Moments] | None = None,
    ) -> None:
        self._features, self._normaliser = features, normaliser
        self._read = read or source.read
        self._config = config
        self._slots = np.repeat(slots, MOMENTS)
        self._lengths = np.array([len(source.poses[slot]) for slot in self._slots])
        spread = (np.tile(np.arange(MOMENTS), len(slots)) + 0.5) / MOMENTS
        self._times = (spread * self._lengths).astype(np.int64)

    def measure(self, policy: nn.Module, machine: Machine) -> dict[str, float]:
        """The policy's scalars, their names prefixed, over all moments alike."""
        policy.eval()
        torch.manual_seed(_SEED)
        sums: dict[str, float] = {}
        for batch in self.batches():
            moved = cast("Batch", {name: value.to(machine.device) for name, value in batch.items()})  # type: ignore[attr-defined]
            with (
                torch.no_grad(),
                torch.autocast(machine.device, torch.bfloat16, enabled=machine.precision == "bf16"),
            ):
                _, scalars = cast("Policy", policy).loss(moved)
            for name, value in scalars.items():
                weight = len(batch["pose"]) / len(self._slots)
                sums[PREFIX + name] = sums.get(PREFIX + name, 0.0) + weight * float(value)
        policy.train()
        return sums

    def batches(self) -> Iterator[Batch]:
        """The moments, normalised."""
        size = self._config.batch_size
        for first in range(0, len(self._slots), size):
            rows = slice(first, first + size)
            steps, valid = chunk_steps(
                self._times[rows], self._lengths[rows], self._features.chunk, self._config.skip
            )
            moments = self._read(self._slots[rows], steps)
            frames = stack_cameras(moments.frames, self._features.cameras)
            without_noise = torch.from_numpy(np.ascontiguousarray(frames))
            yield make_batch(moments, without_noise, valid, self._normaliser, self._features.targets)
