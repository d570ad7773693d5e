"""Weights kept in the layout of oneDNN's own, for predictions on a CPU.

At every call oneDNN lays a plain weight out anew, which for one observation is more work than the product.
The operators are those that torch.compile lowers frozen weights to; where torch lacks them, plain ones do.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from geoprior.policies.fused._passes import arithmetic_of

if TYPE_CHECKING:
    from collections.abc import Callable

_FEW_CELLS = 16
"""Maps of up to so many cells are unfolded: half of the time for 64 of them, and as quick for few."""


def is_packable(x: Tensor) -> bool:
    """Whether nothing is learned or traced, and torch was built with oneDNN for this device and type."""
    traced = torch.compiler.is_compiling() or torch._C._get_tracing_state() is not None
    quiet = not torch.is_grad_enabled() and not traced
    fit = x.device.type == "cpu" and {x.dtype, arithmetic_of(x)} <= {torch.float32, torch.bfloat16}
    return quiet and fit and _has_operators()


class PackedLinear:
    """A linear layer whose weight never changes.

    Args:
        weight: (outputs, inputs).
        bias: (outputs,) or none.
        rows: That it will mostly be called with.
        dtype: Of what it is given and of what it makes: float32 or bfloat16.
    """

    def __init__(self, weight: Tensor, bias: Tensor | None, rows: int, dtype: torch.dtype) -> None:
        self._weight = torch.ops.mkldnn._reorder_linear_weight(weight.to(dtype).contiguous(), rows)
        self._bias = None if bias is None else bias.to(dtype)

    def __call__(self, x: Tensor) -> Tensor:
        """(rows, inputs) to (rows, outputs)."""
        return _operators().linear(x, self._weight, self._bias, "none", [], "")

    def relu(self, x: Tensor) -> Tensor:
        """The ReLU of the same."""
        return _operators().linear(x, self._weight, self._bias, "relu", [], "")

    def plus(self, x: Tensor, other: Tensor) -> Tensor:
        """The same and (rows, outputs) of the same type added to it."""
        return _operators().linear_plus(x, other, self._weight, self._bias, "add")


class PackedConvolution:
    """A convolution with a margin of half the kernel, whose weight never changes.

    Args:
        weight: (outputs, inputs, k, k), k odd.
        bias: (outputs,)
        stride: Of the kernel's steps.
        size: (B, inputs, H, W), of the maps that it will be called with.
        dtype: Of what it is given and of what it makes: float32 or bfloat16.
    """

    def __init__(
        self, weight: Tensor, bias: Tensor, stride: int, size: tuple[int, ...], dtype: torch.dtype
    ) -> None:
        self._geometry = ([weight.shape[-1] // 2] * 2, [stride] * 2, [1, 1], 1)
        laid_out = weight.to(dtype)
        self._weight = torch.ops.mkldnn._reorder_convolution_weight(laid_out, *self._geometry, size)
        self._bias = bias.to(dtype)

    def __call__(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) to (B, outputs, ceil(H / stride), ceil(W / stride))."""
        return _operators().convolution(x, self._weight, self._bias, *self._geometry, "none", [], "")

    def relu(self, x: Tensor) -> Tensor:
        """The ReLU of the same."""
        return _operators().convolution(x, self._weight, self._bias, *self._geometry, "relu", [], "")

    def plus_relu(self, x: Tensor, other: Tensor) -> Tensor:
        """The ReLU of the same with maps of its shape and type added to it."""
        inputs = (x, other, self._weight, self._bias, *self._geometry)
        return _operators().convolution_plus(*inputs, "add", 1.0, "relu", [], "")


class UnfoldedConvolution:
    """The same as `PackedConvolution`, as one product with the neighbourhoods of all cells."""

    def __init__(
        self, weight: Tensor, bias: Tensor, stride: int, size: tuple[int, ...], dtype: torch.dtype
    ) -> None:
        outputs, inputs, kernel, _ = weight.shape
        self._kernel, self._stride = kernel, stride
        self._cells = (size[0], *(-(-length // stride) for length in size[2:]))
        self._places = _places((size[0], *size[2:]), self._cells, kernel, stride)
        self._outside = torch.zeros(1, inputs, dtype=dtype)
        matrix = weight.permute(0, 2, 3, 1).reshape(outputs, kernel * kernel * inputs)
        self._product = PackedLinear(matrix, bias, math.prod(self._cells), dtype)

    def __call__(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) to (B, outputs, ceil(H / stride), ceil(W / stride)), channels last."""
        return self._maps(self._product(self._unfold(x)))

    def relu(self, x: Tensor) -> Tensor:
        """The ReLU of the same."""
        return self._maps(self._product.relu(self._unfold(x)))

    def plus_relu(self, x: Tensor, other: Tensor) -> Tensor:
        """The ReLU of the same with maps of its shape and type added to it."""
        rows = other.permute(0, 2, 3, 1).reshape(-1, other.shape[1])
        return self._maps(self._product.plus(self._unfold(x), rows).relu_())

    def _unfold(self, x: Tensor) -> Tensor:
        """(B * h * w, k * k * C): what the kernel sees; zero outside the map."""
        cells, stride, kernel = x.permute(0, 2, 3, 1), self._stride, self._kernel
        if kernel == 1:
            return cells[:, ::stride, ::stride].reshape(-1, x.shape[1])
        rows = torch.cat([cells.reshape(-1, x.shape[1]), self._outside])
        return rows.index_select(0, self._places).view(-1, kernel * kernel * x.shape[1])

    def _maps(self, rows: Tensor) -> Tensor:
        return rows.view(*self._cells, -1).permute(0, 3, 1, 2)


def _places(size: tuple[int, ...], cells: tuple[int, ...], kernel: int, stride: int) -> Tensor:
    """Which of the cells of maps (B, H, W) the kernel sees in turn; one past the last is outside."""
    last = math.prod(size)
    padded = functional.pad(torch.arange(last).view(size), [kernel // 2] * 4, value=last)
    step, row, column = padded.stride()
    seen = (*cells, kernel, kernel)
    return padded.as_strided(seen, (step, stride * row, stride * column, row, column)).reshape(-1)


def pack_convolution(
    weight: Tensor, bias: Tensor, stride: int, size: tuple[int, ...], dtype: torch.dtype
) -> PackedConvolution | UnfoldedConvolution:
    """Whichever of the two is quick; the arguments are theirs.

    In bfloat16 oneDNN's convolutions are wrong for many maps of one column at a stride of two.
    """
    height, width = (-(-length // stride) for length in size[2:])
    few = height * width <= _FEW_CELLS * stride**2
    unfolded = weight.shape[-1] == 1 or width == 1 or few
    return (UnfoldedConvolution if unfolded else PackedConvolution)(weight, bias, stride, size, dtype)


class _Operators(NamedTuple):
    linear: Callable[..., Tensor]
    linear_plus: Callable[..., Tensor]
    convolution: Callable[..., Tensor]
    convolution_plus: Callable[..., Tensor]


@cache
def _operators() -> _Operators:
    """Found once: torch takes longer to find an operator than to call it."""
    linear, convolution = torch.ops.mkldnn._linear_pointwise, torch.ops.mkldnn._convolution_pointwise
    return _Operators(linear.default, linear.binary, convolution.default, convolution.binary)


@cache
def _has_operators() -> bool:
    names = (
        "_linear_pointwise.binary",
        "_convolution_pointwise.binary",
        "_reorder_linear_weight.default",
        "_reorder_convolution_weight.default",
    )
    built = bool(torch.backends.mkldnn.is_available())  # type: ignore[no-untyped-call]
    return built and all(_has_operator(*name.split(".")) for name in names)


def _has_operator(name: str, overload: str) -> bool:
    return hasattr(getattr(torch.ops.mkldnn, name, None), overload)
