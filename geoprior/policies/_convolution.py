"""Square convolutions, computed as matrix products where feature maps are small.

oneDNN lays the weights of a convolution out anew at every call. Where a map has few cells and many channels
that is most of the work: the three passes through a 3x3 kernel of 512 channels on 16 maps of 3x3 cells take
29 ms so and 6 ms as products of a matrix whose rows are the cells' neighbourhoods (one thread, bfloat16).
"""

from __future__ import annotations

from typing import Any, cast

import torch
from torch import Tensor
from torch.nn import functional

from geoprior.lanes import in_lanes, numbers_of
from geoprior.policies.fused._passes import at_work, is_fusable
from geoprior.policies.fused.products import contract, correlate

_FEW_CELLS = 16
"""Maps of up to so many cells: all passes are products."""
_SOME_CELLS = 64
"""Maps of up to so many: the weights' gradient is one."""
_FEW_ROWS = 256
"""Maps of so many cells, in all that a batch has of them: the same as few cells."""


def convolve(x: Tensor, weight: Tensor, bias: Tensor | None, stride: int) -> Tensor:
    """A convolution with a padding of half the kernel.

    Args:
        x: (B, inputs, H, W).
        weight: (outputs, inputs, k, k), k odd.
        bias: (outputs,) or none.
        stride: Of the kernel's steps.

    Returns:
        (B, outputs, ceil(H / stride), ceil(W / stride)); channels last in memory where products make it.
    """
    kernel = weight.shape[-1]
    cells = -(-x.shape[-2] // stride) * -(-x.shape[-1] // stride)
    elsewhere = x.device.type != "cpu" or torch.compiler.is_compiling()
    if elsewhere or (cells > _SOME_CELLS and kernel > 1):
        return functional.conv2d(x, weight, bias, stride, kernel // 2)
    convolved = cast("Tensor", _Convolution.apply(at_work(x), weight, stride))  # type: ignore[no-untyped-call]
    return convolved if bias is None else convolved + bias.to(convolved.dtype)[:, None, None]


class _Convolution(torch.autograd.Function):
    """The passes of a convolution without bias."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, stride: int) -> Tensor:
        ctx.stride, weight = stride, weight.to(x.dtype)
        if not _as_product(x, weight, stride):
            ctx.save_for_backward(x, weight, None)
            return functional.conv2d(x, weight, None, stride, weight.shape[-1] // 2)
        seen = neighbourhoods(x, weight.shape[-1], stride)
        ctx.save_for_backward(x, weight, seen)
        return _maps(contract(seen, _matrix(weight)), x, stride)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        x, weight, seen = ctx.saved_tensors
        kernel, stride = weight.shape[-1], ctx.stride
        of_x = of_weight = None
        rows = gradient.permute(0, 2, 3, 1).reshape(-1, len(weight))
        if ctx.needs_input_grad[1]:
            product = correlate(rows, neighbourhoods(x, kernel, stride) if seen is None else seen)
            of_weight = product.view(len(weight), kernel, kernel, -1).permute(0, 3, 1, 2)
        if ctx.needs_input_grad[0]:
            if _as_product(x, weight, stride):
                of_x = _scatter(rows @ _matrix(weight), x, kernel, stride)
            else:
                of_x = _gradient_of_input(gradient, x, weight, stride)
        return of_x, of_weight, None


def neighbourhoods(x: Tensor, kernel: int, stride: int) -> Tensor:
    """(B * h * w, k * k * C): for each cell of the result what the kernel sees; zero outside the map."""
    cells = x.permute(0, 2, 3, 1)
    if kernel == 1:
        return cells[:, ::stride, ::stride].reshape(-1, x.shape[1])
    if is_fusable(x):
        from geoprior.policies.fused._kernels import gather_cells

        seen = x.new_empty(len(x), *_size(x, stride), kernel, kernel, x.shape[1])
        in_lanes(gather_cells, seen.numel(), numbers_of(cells.contiguous()), kernel, stride, numbers_of(seen))
        return seen.view(-1, kernel * kernel * x.shape[1])
    margin = kernel // 2
    padded = functional.pad(cells, (0, 0, margin, margin, margin, margin))
    return torch.cat([view for _, _, view in _shifted(padded, x, kernel, stride)], dim=-1).flatten(0, 2)


def _scatter(rows: Tensor, x: Tensor, kernel: int, stride: int) -> Tensor:
    """The transpose of `neighbourhoods`, summed in float32 at least."""
    margin = kernel // 2
    batch, channels, height, width = x.shape
    parts = rows.view(batch, *_size(x, stride), kernel, kernel, channels)
    if is_fusable(rows):
        from geoprior.policies.fused._kernels import scatter_cells

        of_x = rows.new_empty(batch, height, width, channels)
        in_lanes(scatter_cells, rows.numel(), numbers_of(parts), kernel, stride, numbers_of(of_x))
        return of_x.permute(0, 3, 1, 2)
    dtype = torch.promote_types(rows.dtype, torch.float32)
    padded = torch.zeros(batch, height + 2 * margin, width + 2 * margin, channels, dtype=dtype)
    for row, column, view in _shifted(padded, x, kernel, stride):
        view += parts[:, :, :, row, column]
    inner = padded[:, margin : margin + height, margin : margin + width]
    return inner.to(rows.dtype).permute(0, 3, 1, 2)


def _shifted(padded: Tensor, x: Tensor, kernel: int, stride: int) -> list[tuple[int, int, Tensor]]:
    """For each place in the kernel the (B, h, w, C) cells of the padded map that it meets."""
    h, w = _size(x, stride)
    rows, columns = stride * (h - 1) + 1, stride * (w - 1) + 1
    return [
        (row, column, padded[:, row : row + rows : stride, column : column + columns : stride])
        for row in range(kernel)
        for column in range(kernel)
    ]


def _maps(rows: Tensor, x: Tensor, stride: int) -> Tensor:
    return rows.view(len(x), *_size(x, stride), -1).permute(0, 3, 1, 2)


def _matrix(weight: Tensor) -> Tensor:
    """(outputs, k * k * inputs); a view where the channels of the weight are last in memory."""
    return weight.permute(0, 2, 3, 1).reshape(len(weight), -1)


def _size(x: Tensor, stride: int) -> tuple[int, int]:
    return -(-x.shape[-2] // stride), -(-x.shape[-1] // stride)


def _as_product(x: Tensor, weight: Tensor, stride: int) -> bool:
    h, w = _size(x, stride)
    return weight.shape[-1] == 1 or h * w <= _FEW_CELLS or len(x) * h * w <= _FEW_ROWS


def _gradient_of_input(gradient: Tensor, x: Tensor, weight: Tensor, stride: int) -> Tensor:
    steps, margin = [stride, stride], [weight.shape[-1] // 2] * 2
    wanted = [True, False, False]
    of_x: Tensor = torch.ops.aten.convolution_backward(
        gradient,
        x,
        weight,
        None,
        stride=steps,
        padding=margin,
        dilation=[1, 1],
        transposed=False,
        output_padding=[0, 0],
        groups=1,
        output_mask=wanted,
    )[0]
    return of_x
