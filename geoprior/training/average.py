"""The moving average of a policy's weights, which checkpoints may hold in place of the weights themselves.

At a constant learning rate neighbouring checkpoints differ by chance: the last steps go back and forth about
a middle. The average (Polyak and Juditsky 1992) is near that middle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch.optim.swa_utils import AveragedModel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from torch import Tensor, nn

EVERY = 4
"""Optimiser steps from one update to the next: an update at every step costs some per cent of a training."""


class WeightAverage:
    """An exponential moving average of weights and buffers.

    Args:
        policy: Whose; it is copied.
        decay: What is left of an older weight after each optimiser step. In the first steps the average
            forgets faster, so that it does not lag behind: after k updates no more than (1 + k) / (10 + k) of
            it is kept, as TensorFlow's moving averages do it.
        step: Optimiser steps that the training has done.
    """

    def __init__(self, policy: nn.Module, decay: float, step: int = 0) -> None:
        def blend(averages: Sequence[Tensor], weights: Sequence[Tensor], updates: Tensor | int) -> None:
            if not averages[0].is_floating_point():  # the counters of batch norms
                torch._foreach_copy_(list(averages), list(weights))
                return
            count = int(updates)
            kept = min(decay**EVERY, (1.0 + count) / (10.0 + count))
            torch._foreach_lerp_(list(averages), list(weights), 1.0 - kept)

        self._averaged = AveragedModel(policy, multi_avg_fn=blend, use_buffers=True)
        self._averaged.n_averaged.fill_(step // EVERY)

    @property
    def policy(self) -> nn.Module:
        """The policy with the averaged weights."""
        return self._averaged.module

    def update(self, policy: nn.Module, step: int) -> None:
        """Take in the weights after so many optimiser steps."""
        if step % EVERY == 0:
            self._averaged.update_parameters(policy)
