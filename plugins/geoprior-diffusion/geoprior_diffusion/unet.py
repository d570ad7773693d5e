"""The conditional U-Net in time of Diffusion Policy: convolutions over a chunk, modulated by FiLM."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

_GROUPS, _SMALLEST_GROUP = 8, 8
"""Groups of a norm, and the fewest channels in one: a channel normed alone forgets its mean over time."""


class ConvBlock(nn.Sequential):
    """Convolution in time, group norm, Mish: (B, inputs, T) to (B, outputs, T)."""

    def __init__(self, inputs: int, outputs: int, kernel: int) -> None:
        groups = min(_GROUPS, outputs // _SMALLEST_GROUP)
        super().__init__(
            nn.Conv1d(inputs, outputs, kernel, padding=kernel // 2), nn.GroupNorm(groups, outputs), nn.Mish()
        )


class FilmBlock(nn.Module):
    """Two convolutions with a shortcut; after the first, FiLM scales and shifts every channel.

    FiLM (Perez et al. 2018): the condition is mapped to a scale and a shift of each channel, the same at all
    time steps.
    """

    def __init__(self, inputs: int, outputs: int, condition: int, kernel: int) -> None:
        super().__init__()
        self.first = ConvBlock(inputs, outputs, kernel)
        self.film = nn.Sequential(nn.Mish(), nn.Linear(condition, 2 * outputs))
        self.second = ConvBlock(outputs, outputs, kernel)
        self.shortcut = nn.Conv1d(inputs, outputs, 1) if inputs != outputs else nn.Identity()

    def forward(self, x: Tensor, condition: Tensor) -> Tensor:
        """(B, inputs, T) and (B, condition) to (B, outputs, T)."""
        scale, shift = self.film(condition).unsqueeze(-1).chunk(2, dim=1)
        modulated = self.first(x) * (1.0 + scale) + shift
        result: Tensor = self.second(modulated) + self.shortcut(x)
        return result


class Scale(nn.Module):
    """Two blocks at one time scale."""

    def __init__(self, inputs: int, outputs: int, condition: int, kernel: int) -> None:
        super().__init__()
        self.one = FilmBlock(inputs, outputs, condition, kernel)
        self.two = FilmBlock(outputs, outputs, condition, kernel)

    def forward(self, x: Tensor, condition: Tensor) -> Tensor:
        """See `FilmBlock.forward`."""
        result: Tensor = self.two(self.one(x, condition), condition)
        return result


class ConditionalUnet(nn.Module):
    """A sequence to one of the same shape, given a condition.

    Args:
        channels: Of the sequence.
        condition: Length of the condition.
        widths: Channels at each time scale, finest first.
        kernel: Of the convolutions; odd.
    """

    def __init__(self, channels: int, condition: int, widths: tuple[int, ...], kernel: int) -> None:
        super().__init__()
        coarser = list(pairwise(widths))
        self.entry = Scale(channels, widths[0], condition, kernel)
        self.halvings = nn.ModuleList(nn.Conv1d(fine, fine, 3, 2, 1) for fine, _ in coarser)
        self.downs = nn.ModuleList(Scale(fine, coarse, condition, kernel) for fine, coarse in coarser)
        self.middle = Scale(widths[-1], widths[-1], condition, kernel)
        self.doublings = nn.ModuleList(
            nn.ConvTranspose1d(coarse, fine, 4, 2, 1) for fine, coarse in reversed(coarser)
        )
        self.ups = nn.ModuleList(Scale(2 * fine, fine, condition, kernel) for fine, _ in reversed(coarser))
        self.exit = nn.Sequential(ConvBlock(widths[0], widths[0], kernel), nn.Conv1d(widths[0], channels, 1))

    def forward(self, x: Tensor, condition: Tensor) -> Tensor:
        """Run the network.

        Args:
            x: (B, T, channels); T is a multiple of ``2 ** (len(widths) - 1)``.
            condition: (B, condition).

        Returns:
            (B, T, channels)
        """
        x = self.entry(x.transpose(1, 2), condition)
        finer = []
        for halve, down in zip(self.halvings, self.downs, strict=True):
            finer.append(x)
            x = down(halve(x), condition)
        x = self.middle(x, condition)
        for double, up in zip(self.doublings, self.ups, strict=True):
            x = up(torch.cat([double(x), finer.pop()], dim=1), condition)
        said: Tensor = self.exit(x).transpose(1, 2)
        return said
