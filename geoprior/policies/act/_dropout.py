"""Dropout from random bytes: on a CPU, torch draws one Bernoulli an element, four times slower."""

from __future__ import annotations

import torch
from torch import Tensor

_LEVELS = 256


def dropout(x: Tensor, probability: float, *, training: bool) -> Tensor:
    """Zero elements at random and scale the rest so that the expectation stays.

    The probability is rounded to a multiple of 1/256 (0.1 becomes 26/256 = 0.1016), and the scale
    fits the rounded one. Masks come from torch's generator, in whole 64-bit words.
    """
    dropped = round(probability * _LEVELS)
    if not training or dropped == 0:
        return x
    words = torch.empty(-(-x.numel() // 8), dtype=torch.int64, device=x.device)
    noise = words.random_(-(2**63), None).view(torch.int8)[: x.numel()].view(x.shape)
    first_kept = dropped - _LEVELS // 2
    kept = noise.clamp_(first_kept - 1, first_kept).to(x.dtype).sub_(first_kept - 1)
    return x * kept.mul_(_LEVELS / (_LEVELS - dropped))
