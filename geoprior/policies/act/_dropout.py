"""Dropout from random bytes: on a CPU, torch draws one Bernoulli an element, ten times slower."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.nn import functional

if TYPE_CHECKING:
    from numpy.typing import NDArray

_LEVELS = 256
_BITS = {2: torch.uint16, 4: torch.uint32, 8: torch.uint64}
"""Unsigned integers by their bytes."""


def dropout(x: Tensor, probability: float, *, training: bool) -> Tensor:
    """Zero elements at random and scale the rest so that the expectation stays.

    On a CPU the probability is rounded to a multiple of 1/256 (0.1 becomes 26/256 = 0.1016), the scale fits
    the rounded one, and the mask's seed comes from torch's generator. torch.compile draws its own way.
    """
    dropped = round(probability * _LEVELS)
    if not training or dropped == 0:
        return x
    if x.device.type != "cpu" or torch.compiler.is_compiling():
        return functional.dropout(x, probability, training=True)
    return x * _mask(x, dropped)


def _mask(x: Tensor, dropped: int) -> Tensor:
    from geoprior.policies.act._dropout_kernel import fill_mask

    mask = torch.empty(x.shape, dtype=x.dtype)
    kept = torch.tensor([_LEVELS / (_LEVELS - dropped)], dtype=x.dtype)
    seed = int(torch.randint(2**63 - 1, ()))
    fill_mask(seed, dropped, _bits(kept), _bits(mask))
    return mask


def _bits(x: Tensor) -> NDArray[Any]:
    bits: NDArray[Any] = x.view(_BITS[x.element_size()]).numpy().reshape(-1)
    return bits
