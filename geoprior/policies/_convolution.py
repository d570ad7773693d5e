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
from geoprior.policies.fused._passes import arithmetic_of, at_work, is_fusable
from geoprior.policies.fused.products import contract, correlate

_FEW_CELLS = 16
"""Maps of up to so many cells: all passes are products."""
_SOME_CELLS = 64
"""Maps of up to so many: the weights' gradient is one."""
_FEW_CHANNELS = 4
"""Of frames: at steps of two, four cells at a time make channels enough for a vector unit."""
_FEW_ROWS = 256
"""Maps of so many cells, in all that a batch has of them: the same as few cells."""


def convolve(x: Tensor, weight: Tensor, stride: int) -> Tensor:
    """A convolution without bias, with a padding of half the kernel.

    Args:
        x: (B, inputs, H, W).
        weight: (outputs, inputs, k, k), k odd.
        stride: Of the kernel's steps.

    Returns:
        (B, outputs, ceil(H / stride), ceil(W / stride)); channels last in memory where products make it.
    """
    kernel = weight.shape[-1]
    if _is_stem(x, weight, stride):
        return cast("Tensor", _Unshuffled.apply(x, weight))  # type: ignore[no-untyped-call]
    cells = -(-x.shape[-2] // stride) * -(-x.shape[-1] // stride)
    elsewhere = x.device.type != "cpu" or torch.compiler.is_compiling()
    if elsewhere or (cells > _SOME_CELLS and kernel > 1 and not _is_column(x, stride)):
        return functional.conv2d(x, weight, None, stride, kernel // 2)
    return cast("Tensor", _Convolution.apply(at_work(x), weight, stride))  # type: ignore[no-untyped-call]


class _Convolution(torch.autograd.Function):
    """Its two passes."""

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
                of_x = _gradients(gradient, x, weight, stride, kernel // 2, (True, False, False))[0]
        return of_x, of_weight, None


class _Unshuffled(torch.autograd.Function):
    """A convolution at steps of two, of frames whose every 2x2 pixels become one cell: steps of one.

    oneDNN computes the gradient of a 7x7 kernel over three channels at half the rate of that of a 4x4 kernel
    over twelve. The frames get no gradient.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor) -> Tensor:
        cells, kernel = _unshuffle(x, weight.shape[-1]), _unshuffle_kernel(weight.to(torch.bfloat16))
        ctx.save_for_backward(cells, kernel)
        ctx.channels = x.shape[1]
        return functional.conv2d(cells, kernel)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[None, Tensor]:
        cells, kernel = ctx.saved_tensors
        of_kernel = _gradients(gradient, cells, kernel, 1, 0, (False, True, False))[1]
        outputs, _, size, _ = kernel.shape
        parts = of_kernel.view(outputs, 2, 2, ctx.channels, size, size).permute(0, 3, 4, 1, 5, 2)
        return None, parts.reshape(outputs, ctx.channels, 2 * size, 2 * size)[:, :, 1:, 1:]


def _is_stem(x: Tensor, weight: Tensor, stride: int) -> bool:
    """Whether these are frames, to be convolved in bfloat16 on a CPU while a kernel learns."""
    suits = stride == 2 and weight.shape[-1] % 4 == 3 and x.shape[1] <= _FEW_CHANNELS
    learns = torch.is_grad_enabled() and not x.requires_grad
    return suits and learns and is_fusable(x) and arithmetic_of(x) == torch.bfloat16


def _unshuffle(x: Tensor, kernel: int) -> Tensor:
    """(B, 4 * C, h, w) bfloat16 cells of 2x2 pixels, as many as a kernel at steps of two meets."""
    from geoprior.policies.fused._kernels import unshuffle

    rows, columns = (length + kernel // 2 for length in _size(x, 2))
    cells = torch.empty(len(x), rows, columns, 4 * x.shape[1], dtype=torch.bfloat16)
    pixels = x.permute(0, 2, 3, 1).contiguous()
    in_lanes(unshuffle, cells.numel(), *map(numbers_of, (pixels, cells)), kernel // 2 + 1)
    return cells.permute(0, 3, 1, 2)


def _unshuffle_kernel(weight: Tensor) -> Tensor:
    """(outputs, C, k, k) to (outputs, 4 * C, (k + 1) / 2, (k + 1) / 2), zero before its first cells."""
    outputs, channels, kernel, _ = weight.shape
    half = (kernel + 1) // 2
    parts = functional.pad(weight, (1, 0, 1, 0)).view(outputs, channels, half, 2, half, 2)
    unshuffled = parts.permute(0, 3, 5, 1, 2, 4).reshape(outputs, 4 * channels, half, half)
    return unshuffled.contiguous(memory_format=torch.channels_last)


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
    few = h * w <= _FEW_CELLS or len(x) * h * w <= _FEW_ROWS
    return weight.shape[-1] == 1 or few or _is_column(x, stride)


def _is_column(x: Tensor, stride: int) -> bool:
    """Whether it is a case that oneDNN gets wrong in bfloat16: results one cell wide at larger steps."""
    return stride > 1 and _size(x, stride)[1] == 1


def _gradients(
    gradient: Tensor, x: Tensor, weight: Tensor, stride: int, margin: int, wanted: tuple[bool, bool, bool]
) -> tuple[Tensor, Tensor, Tensor]:
    """Of x, of the weight and of a bias, as far as they are wanted."""
    found: tuple[Tensor, Tensor, Tensor] = torch.ops.aten.convolution_backward(
        gradient,
        x,
        weight,
        None,
        stride=[stride, stride],
        padding=[margin, margin],
        dilation=[1, 1],
        transposed=False,
        output_padding=[0, 0],
        groups=1,
        output_mask=list(wanted),
    )
    return found
