"""ResNet-18 for predictions: norms are folded into convolutions, weights lie in oneDNN's layout."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING, cast

import torch

from geoprior.policies.fused.maps import max_pool
from geoprior.policies.fused.packed import PackedConvolution, UnfoldedConvolution, pack_convolution
from geoprior.policies.trunk import affine

if TYPE_CHECKING:
    from torch import Tensor, nn

    from geoprior.policies.trunk import Block, Convolution, FrozenBatchNorm, ResNet18


class PackedTrunk:
    """What a trunk computes in evaluation; its weights are copies.

    Args:
        trunk: Its norms are batch norms, trainable or frozen.
        size: (B, 3, H, W) of the frames.
        dtype: Of the arithmetic and of the result: float32 or bfloat16.
    """

    def __init__(self, trunk: ResNet18, size: tuple[int, ...], dtype: torch.dtype) -> None:
        self._dtype = dtype
        self._stem = _fold(trunk.conv1, trunk.bn1, size, dtype)
        size = _halved(_halved((size[0], trunk.conv1.out_channels, *size[2:])))
        self._blocks = []
        for block in chain(trunk.layer1, trunk.layer2, trunk.layer3, trunk.layer4):
            packed = _PackedBlock(cast("Block", block), size, dtype)
            self._blocks.append(packed)
            size = packed.size

    def __call__(self, frames: Tensor) -> Tensor:
        """(B, 3, H, W) normalised frames to (B, channels, ceil(H / 32), ceil(W / 32)), channels last."""
        frames = frames.to(self._dtype, memory_format=torch.channels_last)
        x = max_pool(self._stem.relu(frames))
        for block in self._blocks:
            x = block(x)
        return x


class _PackedBlock:
    """One residual block; `size` is that of what it makes, (B, C, H, W)."""

    def __init__(self, block: Block, size: tuple[int, ...], dtype: torch.dtype) -> None:
        self._first = _fold(block.conv1, block.bn1, size, dtype)
        self._shortcut: PackedConvolution | UnfoldedConvolution | None = None
        if block.downsample is not None:
            conv, norm = block.downsample
            self._shortcut = _fold(cast("Convolution", conv), norm, size, dtype)
        self.size = (size[0], block.conv1.out_channels, *size[2:])
        if block.conv1.stride[0] == 2:
            self.size = _halved(self.size)
        self._second = _fold(block.conv2, block.bn2, self.size, dtype)

    def __call__(self, x: Tensor) -> Tensor:
        residual = x if self._shortcut is None else self._shortcut(x)
        return self._second.plus_relu(self._first.relu(x), residual)


def _fold(
    convolution: Convolution, norm: nn.Module, size: tuple[int, ...], dtype: torch.dtype
) -> PackedConvolution | UnfoldedConvolution:
    """Both as one; rounded only after they were multiplied."""
    scale, shift = affine(cast("FrozenBatchNorm | nn.BatchNorm2d", norm))
    weight = convolution.weight * scale[:, None, None, None]
    return pack_convolution(weight, shift, convolution.stride[0], size, dtype)


def _halved(size: tuple[int, ...]) -> tuple[int, ...]:
    batch, channels, height, width = size
    return batch, channels, -(-height // 2), -(-width // 2)
