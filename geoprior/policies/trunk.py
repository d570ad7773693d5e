"""The visual trunk, for any policy: ResNet-18 without its classifier (He et al. 2015).

Tensors are named as torchvision names them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from geoprior.policies._convolution import convolve
from geoprior.policies.fused._passes import arithmetic_of
from geoprior.policies.fused.kept import Kept, state_of, versions_of
from geoprior.policies.fused.maps import (
    affine_relu,
    affine_relu_pool,
    batch_norm_relu,
    batch_norm_relu_pool,
    max_pool,
)
from geoprior.policies.fused.packed import is_packable

if TYPE_CHECKING:
    from geoprior.policies._packed_trunk import PackedTrunk
    from geoprior.policies.policy import TrunkNorm

STRIDE = 32
"""Pixels from one cell of the feature map to the next."""
_FEATURE_CELLS = 4
"""Rows and columns of a camera's features, at most."""


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
        self._kept: Kept[tuple[Tensor, Tensor]] = Kept()

    eps = 1e-5

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) to the same."""
        if not torch.is_grad_enabled():  # exports know this operator and fold it
            moments = (self.running_mean, self.running_var)
            return functional.batch_norm(x, *moments, self.weight, self.bias, training=False, eps=self.eps)
        scale, shift = (number.to(x.dtype)[:, None, None] for number in self.affine())
        return torch.addcmul(shift, x, scale)

    def affine(self) -> tuple[Tensor, Tensor]:
        """A factor and an addend for each channel, (C,) each; made anew when a buffer changes."""
        if torch.compiler.is_compiling():
            return affine(self)
        return self._kept.get(versions_of(self.buffers()), lambda: affine(self))


def affine(norm: FrozenBatchNorm | nn.BatchNorm2d) -> tuple[Tensor, Tensor]:
    """What a batch norm with fixed statistics multiplies each channel with, and what it adds."""
    mean, variance = cast("Tensor", norm.running_mean), cast("Tensor", norm.running_var)
    scale = norm.weight * (variance + norm.eps).rsqrt()
    return scale, norm.bias - mean * scale


class Convolution(nn.Conv2d):
    """A convolution without bias that knows the norm after it.

    The tensors are those of a `torch.nn.Conv2d`; the norm keeps its own.
    """

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int) -> None:
        super().__init__(inputs, outputs, kernel, stride, kernel // 2, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) to (B, outputs, ceil(H / stride), ceil(W / stride))."""
        return convolve(x, self.weight, self.stride[0])

    def normalised(self, x: Tensor, norm: nn.Module) -> Tensor:
        """Convolve (B, C, H, W) and normalise."""
        normalised: Tensor = norm(self(x))
        return normalised

    def activated(self, x: Tensor, norm: nn.Module, residual: Tensor | None = None) -> Tensor:
        """The ReLU of the same and of what is added to it."""
        if torch.is_grad_enabled() and isinstance(norm, FrozenBatchNorm):
            return affine_relu(self(x), *norm.affine(), residual)
        if torch.is_grad_enabled() and isinstance(norm, nn.BatchNorm2d) and norm.training:
            return batch_norm_relu(self(x), norm, residual)
        x = self.normalised(x, norm)
        return functional.relu(x if residual is None else x + residual, inplace=True)

    def pooled(self, x: Tensor, norm: nn.Module) -> Tensor:
        """The ReLU of the same, and of it the largest of 3x3 cells in steps of two."""
        if torch.is_grad_enabled() and isinstance(norm, FrozenBatchNorm):
            return affine_relu_pool(self(x), *norm.affine())
        if torch.is_grad_enabled() and isinstance(norm, nn.BatchNorm2d) and norm.training:
            return batch_norm_relu_pool(self(x), norm)
        return max_pool(self.activated(x, norm))


def _group_norm(channels: int) -> nn.Module:
    return nn.GroupNorm(channels // 8, channels)


_NORMS: dict[TrunkNorm, Callable[[int], nn.Module]] = {
    "batch": nn.BatchNorm2d,
    "frozen": FrozenBatchNorm,
    "group": _group_norm,
}


class Block(nn.Module):
    """Two convolutions of 3x3 and a shortcut past them, which is a convolution where sizes change."""

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
        """(B, inputs, H, W) to (B, outputs, ceil(H / stride), ceil(W / stride))."""
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
        self.layer1 = nn.Sequential(Block(width, width, 1, make), Block(width, width, 1, make))
        self.layer2 = nn.Sequential(Block(width, 2 * width, 2, make), Block(2 * width, 2 * width, 1, make))
        self.layer3 = nn.Sequential(
            Block(2 * width, 4 * width, 2, make), Block(4 * width, 4 * width, 1, make)
        )
        self.layer4 = nn.Sequential(
            Block(4 * width, 8 * width, 2, make), Block(8 * width, 8 * width, 1, make)
        )
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
        self._kept: Kept[PackedTrunk] = Kept()

    def forward(self, images: Tensor) -> Tensor:
        """(B, 3, H, W) normalised frames to (B, channels, ceil(H / 32), ceil(W / 32))."""
        state = state_of(self) if is_packable(images) and self.is_foldable() else None
        if state is not None:
            dtype = arithmetic_of(images)
            packed = self._kept.get((state, images.shape, dtype), lambda: self.pack(images.shape, dtype))
            return packed(images)
        x = self.conv1.pooled(images, self.bn1)
        features: Tensor = self.layer4(self.layer3(self.layer2(self.layer1(x))))
        return features

    def is_foldable(self) -> bool:
        """Whether its norms, in evaluation, are fixed affine maps."""
        return isinstance(self.bn1, FrozenBatchNorm | nn.BatchNorm2d)

    def pack(self, size: tuple[int, ...], dtype: torch.dtype) -> PackedTrunk:
        """What it computes in evaluation, with its weights of now, for frames (B, 3, H, W) of a size."""
        from geoprior.policies._packed_trunk import PackedTrunk

        return PackedTrunk(self, size, dtype)


def camera_features(trunk: nn.Module, images: Tensor) -> Tensor:
    """Each camera's feature map, averaged to at most 4 x 4 cells and flattened; without gradients.

    Args:
        trunk: From (B, 3, H, W) to (B, channels, rows, columns).
        images: (B, cameras, 3, H, W) normalised frames.

    Returns:
        (B, cameras, F) float32.
    """
    with torch.no_grad():
        maps = trunk(images.flatten(0, 1)).float()
        rows, columns = (min(size, _FEATURE_CELLS) for size in maps.shape[2:])
        cells: Tensor = functional.adaptive_avg_pool2d(maps, (rows, columns))
    return cells.reshape(*images.shape[:2], -1)
