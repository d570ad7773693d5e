"""ResNet-18 without its classifier (He et al. 2015), tensors named as torchvision names them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

if TYPE_CHECKING:
    from geoprior.policies.act.plugin import Norm

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

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) to the same."""
        scale = self.weight * (self.running_var + 1e-5).rsqrt()
        shift = self.bias - self.running_mean * scale
        return x * scale.to(x.dtype)[:, None, None] + shift.to(x.dtype)[:, None, None]


def _group_norm(channels: int) -> nn.Module:
    return nn.GroupNorm(channels // 8, channels)


_NORMS: dict[Norm, Callable[[int], nn.Module]] = {
    "batch": nn.BatchNorm2d,
    "frozen": FrozenBatchNorm,
    "group": _group_norm,
}


class _Block(nn.Module):
    def __init__(self, inputs: int, outputs: int, stride: int, norm: Callable[[int], nn.Module]) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.bn1 = norm(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False)
        self.bn2 = norm(outputs)
        self.downsample: nn.Module | None = None
        if stride != 1 or inputs != outputs:
            self.downsample = nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride, bias=False), norm(outputs))

    def forward(self, x: Tensor) -> Tensor:
        residual = x if self.downsample is None else self.downsample(x)
        x = functional.relu(self.bn1(self.conv1(x)), inplace=True)
        return functional.relu(self.bn2(self.conv2(x)) + residual, inplace=True)


class ResNet18(nn.Module):
    """Frames to feature maps.

    Args:
        width: Channels after the stem; 64 is the published network. The output has ``8 * width``.
        norm: See `ActConfig.trunk_norm`.
    """

    def __init__(self, width: int, norm: Norm) -> None:
        super().__init__()
        make = _NORMS[norm]
        self.channels = 8 * width
        self.conv1 = nn.Conv2d(3, width, 7, 2, 3, bias=False)
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
        x = functional.relu(self.bn1(self.conv1(images)), inplace=True)
        x = functional.max_pool2d(x, 3, 2, 1)
        features: Tensor = self.layer4(self.layer3(self.layer2(self.layer1(x))))
        return features
