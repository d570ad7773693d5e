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


def takes_half_weights(policy: nn.Module) -> bool:
    """Whether a policy says that its large weights may be bfloat16; see `geoprior.policies.policy.Policy`."""
    return bool(getattr(policy, "half_weights", False))


def halve(policy: nn.Module) -> None:
    """Round the large weights to bfloat16 for good, so that autocast need not do it at every prediction.

    Those of a policy that does not take them stay as they are, and autocast rounds them.
    """
    if not takes_half_weights(policy):
        return
    for parameter in policy.parameters():
        if is_large(parameter):
            parameter.data = parameter.data.to(torch.bfloat16)
