"""Norms, ReLUs and pooling of feature maps, which lie in memory with their channels last."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from geoprior.lanes import in_lanes, numbers_of
from geoprior.policies.fused._passes import CHUNK, chunks_of, is_fusable, none_like

if TYPE_CHECKING:
    from numpy.typing import NDArray

_WIDE = 512
"""Narrow maps are taken several cells at a time, up to so many numbers."""


def affine_relu(x: Tensor, scale: Tensor, shift: Tensor, residual: Tensor | None = None) -> Tensor:
    """``relu(x * scale + shift + residual)``, where scale and shift are constants.

    Args:
        x: (B, C, H, W)
        scale: (C,) without a gradient.
        shift: The same.
        residual: (B, C, H, W) or none.

    Returns:
        (B, C, H, W) of the type of x.
    """
    if is_fusable(x, *([] if residual is None else [residual])):
        return cast("Tensor", _AffineReLU.apply(x, scale, shift, residual))  # type: ignore[no-untyped-call]
    scale, shift = (number.to(x.dtype)[:, None, None] for number in (scale, shift))
    return functional.relu(_plus(torch.addcmul(shift, x, scale), residual), inplace=True)


def batch_norm_relu(x: Tensor, norm: nn.BatchNorm2d, residual: Tensor | None = None) -> Tensor:
    """``relu(norm(x) + residual)`` with the batch's statistics; the running ones follow.

    Args:
        x: (B, C, H, W)
        norm: In training mode, with affine weights, running statistics and a momentum, as it is by default.
        residual: (B, C, H, W) or none.

    Returns:
        (B, C, H, W) of the type of x.
    """
    if not is_fusable(x, *([] if residual is None else [residual])):
        return functional.relu(_plus(norm(x), residual), inplace=True)
    mean, root = _statistics(x, norm)
    inputs = (x, norm.weight, norm.bias, residual, mean, root)
    return cast("Tensor", _BatchNormReLU.apply(*inputs))  # type: ignore[no-untyped-call]


def affine_relu_pool(x: Tensor, scale: Tensor, shift: Tensor) -> Tensor:
    """`affine_relu`, and of it the largest of 3x3 cells in steps of two, with a margin of one.

    Args:
        x: (B, C, H, W)
        scale: (C,) without a gradient.
        shift: The same.

    Returns:
        (B, C, ceil(H / 2), ceil(W / 2)) of the type of x.
    """
    if is_fusable(x):
        return cast("Tensor", _AffinePool.apply(x, scale, shift))  # type: ignore[no-untyped-call]
    return max_pool(affine_relu(x, scale, shift))


def batch_norm_relu_pool(x: Tensor, norm: nn.BatchNorm2d) -> Tensor:
    """`batch_norm_relu` of (B, C, H, W), pooled as `affine_relu_pool` does it."""
    if not is_fusable(x):
        return max_pool(batch_norm_relu(x, norm))
    mean, root = _statistics(x, norm)
    inputs = (x, norm.weight, norm.bias, mean, root)
    return cast("Tensor", _BatchNormPool.apply(*inputs))  # type: ignore[no-untyped-call]


def max_pool(x: Tensor) -> Tensor:
    """The largest of 3x3 cells in steps of two, with a margin of one: (B, C, H, W) to about half of it."""
    return functional.max_pool2d(x, 3, 2, 1)


def _plus(x: Tensor, residual: Tensor | None) -> Tensor:
    return x if residual is None else x + residual


def _statistics(x: Tensor, norm: nn.BatchNorm2d) -> tuple[Tensor, Tensor]:
    """Mean and reciprocal deviation of every channel, float32; the norm's running ones follow."""
    mean, variance = _moments(x.detach())
    _follow(norm, mean, variance, x.numel() // x.shape[1])
    return mean, (variance + norm.eps).rsqrt()


def _moments(x: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and variance of every channel, float32."""
    from geoprior.policies.fused._kernels import channel_moments

    rows = _rows(x)
    origin = rows[0].float()
    sums = torch.empty(chunks_of(rows), 2, rows.shape[1])
    in_lanes(channel_moments, x.numel(), CHUNK, *map(numbers_of, (rows, origin, sums)))
    channels = x.shape[1]
    # Cells that were taken side by side have origins of their own.
    cells = x.numel() // channels
    side = origin.view(-1, channels).double()
    total, square = sums.double().sum(0).view(2, -1, channels)
    count = len(rows)
    mean = (total + count * side).sum(0) / cells
    away = side - mean
    variance = (square + 2.0 * away * total + count * away.square()).sum(0) / cells
    return mean.float(), variance.clamp_min(0.0).float()


@torch.no_grad()
def _follow(norm: nn.BatchNorm2d, mean: Tensor, variance: Tensor, count: int) -> None:
    """Move the running statistics, as torch's batch norm does."""
    running_mean, running_var = cast("Tensor", norm.running_mean), cast("Tensor", norm.running_var)
    momentum = cast("float", norm.momentum)
    cast("Tensor", norm.num_batches_tracked).add_(1)
    running_mean.lerp_(mean, momentum)
    running_var.lerp_(variance * (count / max(count - 1, 1)), momentum)


def _rows(x: Tensor) -> Tensor:
    """(rows, k * C) of a map: k cells side by side, a power of two; a view where it can be."""
    channels = x.shape[1]
    cells = x.numel() // channels
    side = 1
    while cells % (2 * side) == 0 and 2 * side * channels <= _WIDE:
        side *= 2
    return x.permute(0, 2, 3, 1).reshape(cells // side, side * channels)


def _empty_maps(x: Tensor) -> Tensor:
    return torch.empty_like(x, memory_format=torch.channels_last)


def _tiled(numbers: Tensor, rows: Tensor) -> NDArray[np.float32]:
    """(..., C) float32 repeated to the width of the rows."""
    side = rows.shape[1] // numbers.shape[-1]
    return numbers_of(numbers.float().repeat(*[1] * (numbers.dim() - 1), side))


def _apply(x: Tensor, scale: Tensor, shift: Tensor, residual: Tensor | None) -> Tensor:
    from geoprior.policies.fused._kernels import affine_relu

    rows, y = _rows(x), _empty_maps(x)
    added = none_like(rows) if residual is None else _rows(residual)
    coefficients = (_tiled(scale, rows), _tiled(shift, rows))
    in_lanes(affine_relu, x.numel(), *map(numbers_of, (rows, added)), *coefficients, numbers_of(_rows(y)))
    return y


def _back(
    gradient: Tensor, y: Tensor, x: Tensor | None, coefficients: Tensor, *, residual: bool
) -> tuple[Tensor, Tensor | None]:
    """Gradients of x and of the residual; ``coefficients`` (3, C) as the kernel wants them."""
    from geoprior.policies.fused._kernels import relu_affine_back

    of_x, of_residual = _empty_maps(y), _empty_maps(y) if residual else None
    rows = _rows(y)
    given = (_rows(gradient), rows, none_like(rows) if x is None else _rows(x))
    results = (_rows(of_x), none_like(rows) if of_residual is None else _rows(of_residual))
    arguments = (*map(numbers_of, given), _tiled(coefficients, rows), *map(numbers_of, results))
    in_lanes(relu_affine_back, y.numel(), *arguments)
    return of_x, of_residual


class _AffineReLU(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, scale: Tensor, shift: Tensor, residual: Tensor | None) -> Tensor:
        y = _apply(x, scale, shift, residual)
        ctx.save_for_backward(y, scale)
        ctx.has_residual = residual is not None
        return y

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        y, scale = ctx.saved_tensors
        of_x, of_residual = _back(gradient, y, None, scale.expand(3, -1), residual=ctx.has_residual)
        return of_x, None, None, of_residual


class _BatchNormReLU(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, x: Tensor, weight: Tensor, bias: Tensor, residual: Tensor | None, mean: Tensor, root: Tensor
    ) -> Tensor:
        scale = weight * root
        y = _apply(x, scale, bias - mean * scale, residual)
        ctx.save_for_backward(x, y, weight, mean, root)
        ctx.has_residual = residual is not None
        return y

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, y, weight, mean, root = ctx.saved_tensors
        total, product = _gradient_sums(gradient, y, x, mean)
        coefficients = _coefficients(x, weight * root, root, mean, total, product)
        of_x, of_residual = _back(gradient, y, x, coefficients, residual=ctx.has_residual)
        return of_x, product * root, total, of_residual, None, None


def _gradient_sums(gradient: Tensor, y: Tensor, x: Tensor, mean: Tensor) -> tuple[Tensor, Tensor]:
    """By channel, the sum of the ReLU's gradient and that of its product with x - mean; float32."""
    from geoprior.policies.fused._kernels import relu_sums

    rows = _rows(x)
    sums = torch.empty(chunks_of(rows), 2, rows.shape[1])
    given = map(numbers_of, (_rows(gradient), _rows(y), rows))
    in_lanes(relu_sums, x.numel(), CHUNK, *given, _tiled(mean, rows), numbers_of(sums))
    total, product = sums.double().sum(0).view(2, -1, x.shape[1]).sum(1).float()
    return total, product


def _coefficients(
    x: Tensor, scale: Tensor, root: Tensor, mean: Tensor, total: Tensor, product: Tensor
) -> Tensor:
    """(3, C) what a batch norm's gradient multiplies that of its result and x with, and what it adds."""
    cells = x.numel() / x.shape[1]
    tilt = -scale * root.square() * product / cells
    return torch.stack([scale, tilt, -scale * total / cells - tilt * mean])


class _AffinePool(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, scale: Tensor, shift: Tensor) -> Tensor:
        y, place, _ = _pool(x, scale, shift, choose=False)
        ctx.save_for_backward(place, scale)
        ctx.shape = x.shape
        return y

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        place, scale = ctx.saved_tensors
        return _pool_back(gradient, place, None, scale.expand(3, -1).contiguous(), ctx.shape), None, None


class _BatchNormPool(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, bias: Tensor, mean: Tensor, root: Tensor) -> Tensor:
        scale = weight * root
        y, place, chosen = _pool(x, scale, bias - mean * scale, choose=True)
        ctx.save_for_backward(x, y, place, chosen, weight, mean, root)
        return y

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, y, place, chosen, weight, mean, root = ctx.saved_tensors
        total, product = _gradient_sums(gradient, y, chosen, mean)
        coefficients = _coefficients(x, weight * root, root, mean, total, product)
        return _pool_back(gradient, place, x, coefficients, x.shape), product * root, total, None, None


def _pool(x: Tensor, scale: Tensor, shift: Tensor, *, choose: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Pooled maps (B, C, h, w), the places (B, h, w, C), and what was chosen of x, as maps."""
    from geoprior.policies.fused._kernels import affine_relu_pool

    batch, channels, height, width = x.shape
    y = x.new_empty(batch, (height + 1) // 2, (width + 1) // 2, channels)
    place = torch.empty(y.shape, dtype=torch.uint8)
    chosen = torch.empty_like(y) if choose else none_like(y)
    given = (_cells(x), scale.float(), shift.float())
    in_lanes(affine_relu_pool, x.numel(), *map(numbers_of, (*given, y, place, chosen)))
    return y.permute(0, 3, 1, 2), place, chosen.permute(0, 3, 1, 2)


def _pool_back(
    gradient: Tensor, place: Tensor, x: Tensor | None, coefficients: Tensor, shape: torch.Size
) -> Tensor:
    from geoprior.policies.fused._kernels import pool_affine_back

    batch, channels, height, width = shape
    of_x = gradient.new_empty(batch, height, width, channels)
    values = none_like(of_x) if x is None else _cells(x)
    numbers = (_cells(gradient), place, values, coefficients, of_x)
    in_lanes(pool_affine_back, of_x.numel(), *map(numbers_of, numbers))
    return of_x.permute(0, 3, 1, 2)


def _cells(x: Tensor) -> Tensor:
    """(B, H, W, C) contiguous."""
    return x.permute(0, 2, 3, 1).contiguous()
