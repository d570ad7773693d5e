"""Matrix products of bfloat16 on a CPU, in the shapes and orders that oneDNN is quick at.

Measured for weights of 512x3200 and hundreds of rows, with AMX: a weight lies best with its longer axis
contiguous (`lay_out`); a product that ends in few columns takes two thirds of the time when it is cut into
blocks of 256 columns; and ``a.T @ b`` gains a quarter when the smaller of the two is laid out anew first.
"""

from __future__ import annotations

from typing import Any, TypeVar, cast

import torch
from torch import Tensor
from torch.nn import functional

from geoprior.lanes import in_lanes, numbers_of
from geoprior.policies.fused._passes import is_fusable
from geoprior.policies.fused.packed import is_packable, packed_linear

_COLUMNS = 256
"""Of a block."""
_ROWS = 512
"""Fewer are not worth cutting."""


Weight = TypeVar("Weight", bound=Tensor)


def lay_out(weight: Weight) -> Weight:
    """The weight with its longer axis contiguous in memory; its shape is what it was."""
    if weight.shape[0] > weight.shape[1]:
        weight.data = weight.data.t().contiguous().t()
    return weight


def linear(x: Tensor, weight: Tensor) -> Tensor:
    """``x @ weight.T``; under autocast in its type.

    Args:
        x: (..., inputs)
        weight: (outputs, inputs), best laid out by `lay_out`.

    Returns:
        (..., outputs)
    """
    if x.device.type != "cpu" or torch.compiler.is_compiling() or not _in_bfloat16(x):
        return functional.linear(x, weight)
    if weight.dtype == torch.bfloat16 and is_packable(x):
        return packed_linear(x.flatten(0, -2).to(weight.dtype), weight).view(*x.shape[:-1], -1)
    rows = cast("Tensor", _Linear.apply(x.flatten(0, -2), weight))  # type: ignore[no-untyped-call]
    return rows.view(*x.shape[:-1], -1)


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
    if not is_fusable(small, large):
        return small.t().contiguous() @ large
    from geoprior.policies.fused._kernels import transpose

    laid_out = small.new_empty(small.shape[1], len(small))
    in_lanes(transpose, small.numel(), numbers_of(small.contiguous()), numbers_of(laid_out))
    return laid_out @ large


def _in_bfloat16(x: Tensor) -> bool:
    autocast = torch.is_autocast_enabled("cpu") and torch.get_autocast_dtype("cpu") == torch.bfloat16
    return autocast or x.dtype == torch.bfloat16


class _Linear(torch.autograd.Function):
    @staticmethod
    @torch.amp.custom_fwd(device_type="cpu", cast_inputs=torch.bfloat16)  # type: ignore[untyped-decorator]
    def forward(ctx: Any, x: Tensor, weight: Tensor) -> Tensor:
        ctx.save_for_backward(x, weight)
        outputs, inputs = weight.shape
        return contract(x, weight) if outputs <= inputs else x @ weight.t()

    @staticmethod
    @torch.amp.custom_bwd(device_type="cpu")  # type: ignore[untyped-decorator]
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, Tensor | None]:
        x, weight = ctx.saved_tensors
        outputs, inputs = weight.shape
        of_x = of_weight = None
        if ctx.needs_input_grad[0]:
            of_x = gradient @ weight if outputs <= inputs else contract(gradient, weight.t())
        if ctx.needs_input_grad[1]:
            narrow = outputs <= inputs
            of_weight = correlate(gradient, x) if narrow else correlate(x, gradient).t()
        return of_x, of_weight
