"""Matrix products of rows and weights, in the shapes and orders that oneDNN is quick at.

Measured in bfloat16 for weights of 512x3200 and hundreds of rows, with AMX: a weight lies best with its
longer axis contiguous (`lay_out`); a product that ends in few columns takes two thirds of the time when it is
cut into blocks of 256 columns; and ``a.T @ b`` gains a quarter when the smaller one is laid out anew first.
"""

from __future__ import annotations

from typing import TypeVar

import torch
from torch import Tensor

from geoprior.lanes import in_lanes, numbers_of

_COLUMNS = 256
"""Of a block."""
_ROWS = 512
"""Fewer are not worth cutting."""
_UNEVEN = range(208, 512)
"""Rows at which the rate of a wide product depends on chance: for 512x3200 it is 345 GFLOP/s at 216 rows and
590 at 243, for 512x1536 580 and 310. In blocks of about `_WIDE` columns it is 510 to 560 at either."""
_WIDE = 800


Weight = TypeVar("Weight", bound=Tensor)


def lay_out(weight: Weight) -> Weight:
    """The weight with its longer axis contiguous in memory; its shape is what it was."""
    if weight.shape[0] > weight.shape[1]:
        weight.data = weight.data.t().contiguous().t()
    return weight


def product(x: Tensor, weight: Tensor) -> Tensor:
    """``x @ weight.T``.

    Args:
        x: (rows, inputs)
        weight: (outputs, inputs) of the same type, best laid out by `lay_out`.

    Returns:
        (rows, outputs)
    """
    outputs, inputs = weight.shape
    return contract(x, weight) if outputs <= inputs else x @ weight.t()


def gradient_of_rows(gradient: Tensor, weight: Tensor) -> Tensor:
    """What a `product` passes back to its rows: (rows, outputs) to (rows, inputs)."""
    outputs, inputs = weight.shape
    return gradient @ weight if outputs <= inputs else contract(gradient, weight.t())


def gradient_of_weight(gradient: Tensor, x: Tensor) -> Tensor:
    """What a `product` passes back to its weight: (outputs, inputs), lying as `lay_out` would lay it."""
    narrow = gradient.shape[1] <= x.shape[1]
    return correlate(gradient, x) if narrow else correlate(x, gradient).t()


def contract(x: Tensor, weight: Tensor) -> Tensor:
    """``x @ weight.T`` for a weight (N, K) with N <= K that is contiguous: (rows, K) to (rows, N)."""
    if len(x) < _ROWS or len(weight) <= _COLUMNS or x.dtype != torch.bfloat16:
        return x @ weight.t()
    y = x.new_empty(len(x), len(weight))
    for first in range(0, len(weight), _COLUMNS):
        block = slice(first, first + _COLUMNS)
        torch.mm(x, weight[block].t(), out=y[:, block])
    return y


def correlate(small: Tensor, large: Tensor) -> Tensor:
    """``small.T @ large``: (rows, M) and (rows, N) with M <= N to (M, N)."""
    if small.dtype != torch.bfloat16 or small.device.type != "cpu":
        return small.t() @ large
    from geoprior.policies.fused._kernels import transpose

    laid_out = small.new_empty(small.shape[1], len(small))
    in_lanes(transpose, small.numel(), numbers_of(small.contiguous()), numbers_of(laid_out))
    parts = -(-large.shape[1] // _WIDE) if len(small) in _UNEVEN else 1
    if parts == 1:
        return laid_out @ large
    y = small.new_empty(small.shape[1], large.shape[1])
    for block, of_block in zip(large.tensor_split(parts, 1), y.tensor_split(parts, 1), strict=True):
        torch.mm(laid_out, block, out=of_block)
    return y
