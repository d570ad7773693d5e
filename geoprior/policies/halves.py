"""Which of a policy's weights may be bfloat16 where it is run under autocast."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from torch import nn

LARGE = 2**14
"""Parameters of two axes or more and at least so many numbers are matrices and kernels, which a network under
autocast meets in bfloat16 anyway."""


def is_large(parameter: nn.Parameter) -> bool:
    """Whether it is such a matrix or kernel, and dense in memory."""
    dense = parameter.untyped_storage().nbytes() == parameter.numel() * parameter.element_size()
    return parameter.dim() > 1 and parameter.numel() >= LARGE and dense


def halve(policy: nn.Module) -> None:
    """Round the large weights to bfloat16 for good, so that autocast need not do it at every prediction."""
    for parameter in policy.parameters():
        if is_large(parameter):
            parameter.data = parameter.data.to(torch.bfloat16)
