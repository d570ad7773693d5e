"""The visual trunk, for any policy: ResNet-18 without its classifier (He et al. 2015).

Tensors are named as torchvision names them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeGuard, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from geoprior.policies._convolution import convolve
from geoprior.policies.fused.maps import (
    affine_relu,
    affine_relu_pool,
    batch_norm_relu,
    batch_norm_relu_pool,
    max_pool,
)
from geoprior.policies.fused.packed import is_packable, pack_kernel, packed_convolution

if TYPE_CHECKING:
    from geoprior.policies.policy import TrunkNorm

STRIDE = 32
"""Pixels from one cell of the feature map to the next."""


class FrozenBatchNorm(nn.Module):
    """Batch norm whose statistics and affine weights are constants; they load from a batch norm's."""

    weight: Tensor
    bias: Tensor
    running_mean: Tensor
    running_var: Tensor

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.register_buffer("weight", torch.ones(channels))
        self.register_buffer("bias", torch.zeros(channels))
        self.register_buffer("running_mean", torch.zeros(channels))
        self.register_buffer("running_var", torch.ones(channels))

    eps = 1e-5

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) to the same."""
        scale, shift = (number.to(x.dtype)[:, None, None] for number in affine(self))
        return torch.addcmul(shift, x, scale)


def affine(norm: FrozenBatchNorm | nn.BatchNorm2d) -> tuple[Tensor, Tensor]:
    """What a batch norm with fixed statistics multiplies each channel with, and what it adds."""
    mean, variance = cast("Tensor", norm.running_mean), cast("Tensor", norm.running_var)
    scale = norm.weight * (variance + norm.eps).rsqrt()
    return scale, norm.bias - mean * scale


class Convolution(nn.Conv2d):
    """A convolution without bias and the norm after it, as one where the norm is a fixed affine map.

    The tensors are those of a `torch.nn.Conv2d`; the norm keeps its own.
    """

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int) -> None:
        super().__init__(inputs, outputs, kernel, stride, kernel // 2, bias=False)
        self._folded: tuple[tuple[object, ...], Tensor, Tensor] | None = None
        self._packed: tuple[tuple[object, ...], Tensor, Tensor] | None = None

    def normalised(self, x: Tensor, norm: nn.Module) -> Tensor:
        """Convolve (B, C, H, W) and normalise; at once where the norm is fixed and nothing is learned."""
        if _is_fixed(norm):
            if is_packable(x):
                return self._run_packed(x, norm, relu=False, residual=None)
            return convolve(x, *self._fold(norm), self.stride[0])
        normalised: Tensor = norm(convolve(x, self.weight, None, self.stride[0]))
        return normalised

    def activated(self, x: Tensor, norm: nn.Module, residual: Tensor | None = None) -> Tensor:
        """The ReLU of the same and of what is added to it."""
        if torch.is_grad_enabled() and isinstance(norm, FrozenBatchNorm):
            return affine_relu(convolve(x, self.weight, None, self.stride[0]), *affine(norm), residual)
        if torch.is_grad_enabled() and isinstance(norm, nn.BatchNorm2d) and norm.training:
            return batch_norm_relu(convolve(x, self.weight, None, self.stride[0]), norm, residual)
        if _is_fixed(norm) and is_packable(x):
            return self._run_packed(x, norm, relu=True, residual=residual)
        x = self.normalised(x, norm)
        return functional.relu(x if residual is None else x + residual, inplace=True)

    def pooled(self, x: Tensor, norm: nn.Module) -> Tensor:
        """The ReLU of the same, and of it the largest of 3x3 cells in steps of two."""
        if torch.is_grad_enabled() and isinstance(norm, FrozenBatchNorm):
            return affine_relu_pool(convolve(x, self.weight, None, self.stride[0]), *affine(norm))
        if torch.is_grad_enabled() and isinstance(norm, nn.BatchNorm2d) and norm.training:
            return batch_norm_relu_pool(convolve(x, self.weight, None, self.stride[0]), norm)
        return max_pool(self.activated(x, norm))

    def _run_packed(
        self, x: Tensor, norm: FrozenBatchNorm | nn.BatchNorm2d, *, relu: bool, residual: Tensor | None
    ) -> Tensor:
        """Weights keep the layout that they have for the shape and type of x, until they are written to."""
        dtype = torch.get_autocast_dtype("cpu") if torch.is_autocast_enabled("cpu") else x.dtype
        weight, shift = self._fold(norm)
        state = (cast("tuple[object, ...]", self._folded)[0], x.shape, dtype)
        if self._packed is None or self._packed[0] != state:
            self._packed = (state, pack_kernel(weight.to(dtype), self.stride[0], x.shape), shift.to(dtype))
        kernel, stride = self.kernel_size[0], self.stride[0]
        return packed_convolution(
            x.to(dtype), *self._packed[1:], kernel, stride, relu=relu, residual=residual
        )

    def __getstate__(self) -> dict[str, object]:
        """Copies derive anew what they keep."""
        return {**self.__dict__, "_folded": None, "_packed": None}

    def _fold(self, norm: FrozenBatchNorm | nn.BatchNorm2d) -> tuple[Tensor, Tensor]:
        """Weight and bias, kept until a tensor that they come from is written to."""
        sources = (self.weight, *norm.parameters(), *norm.buffers())
        state = tuple((tensor.data_ptr(), tensor._version) for tensor in sources)
        if self._folded is None or self._folded[0] != state:
            scale, shift = affine(norm)
            weight = (self.weight * scale[:, None, None, None]).to(self.weight.dtype)
            self._folded = (state, weight.contiguous(memory_format=torch.channels_last), shift)
        return self._folded[1:]


def _is_fixed(norm: nn.Module) -> TypeGuard[FrozenBatchNorm | nn.BatchNorm2d]:
    """Whether it is one affine map for all, and nothing is learned."""
    fixed = isinstance(norm, FrozenBatchNorm) or (isinstance(norm, nn.BatchNorm2d) and not norm.training)
    return fixed and not torch.is_grad_enabled()


def _group_norm(channels: int) -> nn.Module:
    return nn.GroupNorm(channels // 8, channels)


_NORMS: dict[TrunkNorm, Callable[[int], nn.Module]] = {
    "batch": nn.BatchNorm2d,
    "frozen": FrozenBatchNorm,
    "group": _group_norm,
}


class _Block(nn.Module):
    def __init__(self, inputs: int, outputs: int, stride: int, norm: Callable[[int], nn.Module]) -> None:
        super().__init__()
        self.conv1 = Convolution(inputs, outputs, 3, stride)
        self.bn1 = norm(outputs)
        self.conv2 = Convolution(outputs, outputs, 3, 1)
        self.bn2 = norm(outputs)
        self.downsample: nn.Sequential | None = None
        if stride != 1 or inputs != outputs:
            self.downsample = nn.Sequential(Convolution(inputs, outputs, 1, stride), norm(outputs))

    def forward(self, x: Tensor) -> Tensor:
        residual = x
        if self.downsample is not None:
            conv, norm = self.downsample
            residual = cast("Convolution", conv).normalised(x, norm)
        return self.conv2.activated(self.conv1.activated(x, self.bn1), self.bn2, residual)


class ResNet18(nn.Module):
    """Frames to feature maps.

    Args:
        width: Channels after the stem; 64 is the published network. The output has ``8 * width``.
        norm: See `geoprior.policies.policy.TrunkNorm`.
    """

    def __init__(self, width: int, norm: TrunkNorm) -> None:
        super().__init__()
        make = _NORMS[norm]
        self.channels = 8 * width
        self.conv1 = Convolution(3, width, 7, 2)
        self.bn1 = make(width)
        self.layer1 = nn.Sequential(_Block(width, width, 1, make), _Block(width, width, 1, make))
        self.layer2 = nn.Sequential(_Block(width, 2 * width, 2, make), _Block(2 * width, 2 * width, 1, make))
        self.layer3 = nn.Sequential(
            _Block(2 * width, 4 * width, 2, make), _Block(4 * width, 4 * width, 1, make)
        )
        self.layer4 = nn.Sequential(
            _Block(4 * width, 8 * width, 2, make), _Block(8 * width, 8 * width, 1, make)
        )
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, images: Tensor) -> Tensor:
        """(B, 3, H, W) normalised frames to (B, channels, ceil(H / 32), ceil(W / 32))."""
        x = self.conv1.pooled(images, self.bn1)
        features: Tensor = self.layer4(self.layer3(self.layer2(self.layer1(x))))
        return features
