"""The exponential moving average of a network's weights, kept where a checkpoint finds it."""

from __future__ import annotations

import copy
from typing import Generic, Self, TypeVar

import torch
from torch import nn

Network = TypeVar("Network", bound=nn.Module)

_WARM = 9
"""After n updates the average looks back on n / 9 steps at most: the first weights are soon forgotten."""


class Average(nn.Module, Generic[Network]):
    """A copy of a network, always in evaluation mode, whose weights follow the network's.

    The copy's weights are buffers: they are in the state dict, so that checkpoints and resumed trainings have
    them, and the optimiser does not see them. A trainer that cuts a batch into parts gives every part the
    buffers of the step's beginning; the average therefore moves once a step, however many parts there are.
    Where the trainer lends the network its weights in bfloat16, those are averaged, in float32.

    Args:
        network: What to copy.
        decay: Of the average, at most; 0 keeps the last weights.
    """

    updates: torch.Tensor

    def __init__(self, network: Network, decay: float) -> None:
        super().__init__()
        self.decay = decay
        self.network = copy.deepcopy(network)
        _freeze(self.network)
        self.register_buffer("updates", torch.zeros((), dtype=torch.int64))
        self.eval()

    @torch.no_grad()
    def follow(self, network: Network) -> None:
        """Move towards the network's weights; the first time, all the way. Its buffers are copied."""
        done = int(self.updates)
        share = 1.0 - min(self.decay, done / (done + _WARM))
        mine = dict(self.network.named_buffers())
        for name, parameter in network.named_parameters():
            mine[name].lerp_(parameter.to(mine[name].dtype), share)
        for name, buffer in network.named_buffers():
            mine[name].copy_(buffer)
        self.updates += 1

    def train(self, mode: bool = True) -> Self:  # noqa: ARG002, FBT001, FBT002 - torch's signature
        """Stay in evaluation mode."""
        return super().train(False)  # noqa: FBT003


def _freeze(network: nn.Module) -> None:
    """Turn parameters into buffers of the same names."""
    for module in network.modules():
        for name, parameter in list(module.named_parameters(recurse=False)):
            delattr(module, name)
            module.register_buffer(name, parameter.detach())
