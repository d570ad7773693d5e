"""Fixed sinusoidal position embeddings, of sequences and of feature maps."""

from __future__ import annotations

import math

import torch
from torch import Tensor

_TEMPERATURE = 10_000.0


def sinusoid_1d(positions: int, dim: int) -> Tensor:
    """The embedding of Vaswani et al. 2017: sines in even channels, cosines in odd ones.

    Returns:
        (positions, dim) float32.
    """
    return _interleave(torch.arange(positions, dtype=torch.float64), dim).float()


def sinusoid_2d(height: int, width: int, dim: int) -> Tensor:
    """The embedding of DETR (Carion et al. 2020), with positions scaled to (0, 2 pi].

    Args:
        height: Rows of the feature map.
        width: Columns.
        dim: Channels, a multiple of 4: the first half says the row, the second the column.

    Returns:
        (height, width, dim) float32.
    """
    rows = _interleave(_scaled(height), dim // 2)[:, None, :].expand(height, width, dim // 2)
    columns = _interleave(_scaled(width), dim // 2)[None, :, :].expand(height, width, dim // 2)
    return torch.cat([rows, columns], dim=-1).float()


def _scaled(count: int) -> Tensor:
    return torch.arange(1, count + 1, dtype=torch.float64) / (count + 1e-6) * 2.0 * math.pi


def _interleave(positions: Tensor, dim: int) -> Tensor:
    channel = torch.arange(dim)
    angles = positions[:, None] / _TEMPERATURE ** (2.0 * (channel // 2) / dim)
    return torch.where(channel % 2 == 0, angles.sin(), angles.cos())
