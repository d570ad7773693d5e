"""Weights kept in the layout of oneDNN's own, for predictions on a CPU.

At every call oneDNN lays a plain weight out anew, which for one observation is more work than the product.
The operators are those that torch.compile lowers frozen weights to; where torch lacks them, plain ones do.
"""

from __future__ import annotations

from collections.abc import MutableMapping
from functools import cache
from typing import cast

import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

_kept: MutableMapping[Tensor, tuple[tuple[int, ...], Tensor]] = WeakIdKeyDictionary()
"""Weights to what they were laid out from and for, and as what."""


def is_packable(x: Tensor) -> bool:
    """Whether nothing is learned or traced, and torch was built with oneDNN for this device and type."""
    quiet = not torch.is_grad_enabled() and not torch.compiler.is_compiling()
    fit = x.device.type == "cpu" and x.dtype in {torch.float32, torch.bfloat16}
    return quiet and fit and _has_operators()


def packed_linear(x: Tensor, weight: Tensor) -> Tensor:
    """``x @ weight.T``: (rows, inputs) and a weight (outputs, inputs) of one type to (rows, outputs)."""
    state = (weight.data_ptr(), weight._version, len(x))
    kept = _kept.get(weight)
    if kept is None or kept[0] != state:
        packed = torch.ops.mkldnn._reorder_linear_weight(weight.contiguous(), len(x))
        kept = _kept[weight] = (state, packed)
    return cast("Tensor", torch.ops.mkldnn._linear_pointwise(x, kept[1], None, "none", [], ""))


def pack_kernel(weight: Tensor, stride: int, size: torch.Size) -> Tensor:
    """The weight (outputs, inputs, k, k) of a convolution with a margin of k / 2, for maps of a size."""
    margin = [weight.shape[-1] // 2] * 2
    packed = torch.ops.mkldnn._reorder_convolution_weight(weight, margin, [stride] * 2, [1, 1], 1, size)
    return cast("Tensor", packed)


def packed_convolution(
    x: Tensor, packed: Tensor, bias: Tensor, kernel: int, stride: int, *, relu: bool, residual: Tensor | None
) -> Tensor:
    """The ReLU, if wanted, of a convolution and a residual, in one pass.

    Args:
        x: (B, inputs, H, W)
        packed: By `pack_kernel`.
        bias: (outputs,) of the type of x.
        kernel: Its size.
        stride: Of its steps.
        relu: Whether to apply it.
        residual: (B, outputs, h, w) or none; it comes with the ReLU only.
    """
    geometry = ([kernel // 2] * 2, [stride] * 2, [1, 1], 1)
    operator = torch.ops.mkldnn._convolution_pointwise
    if residual is None:
        return cast("Tensor", operator(x, packed, bias, *geometry, "relu" if relu else "none", [], ""))
    added = operator.binary(x, residual, packed, bias, *geometry, "add", 1.0, "relu", [], "")
    return cast("Tensor", added)


@cache
def _has_operators() -> bool:
    names = (
        "_linear_pointwise",
        "_convolution_pointwise",
        "_reorder_linear_weight",
        "_reorder_convolution_weight",
    )
    built = bool(torch.backends.mkldnn.is_available())  # type: ignore[no-untyped-call]
    return built and all(hasattr(torch.ops.mkldnn, name) for name in names)
