"""Frames on their way into a batch: moved and made noisy."""

from __future__ import annotations

from statistics import NormalDist
from typing import TYPE_CHECKING

import cv2
import numpy as np
import torch

if TYPE_CHECKING:
    from numpy.typing import NDArray

_LEVELS = 256


def shift_frames(frames: NDArray[np.uint8], largest: int, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Move each frame by its own random whole number of pixels; what comes in repeats the edge.

    Args:
        frames: (B, cameras, H, W, C).
        largest: Pixels, each way.
        rng: Drawn from once.
    """
    batch, cameras, height, width = frames.shape[:4]
    moves = rng.integers(-largest, largest + 1, size=(2, batch, cameras, 1))
    rows = np.clip(np.arange(height) + moves[0], 0, height - 1)
    columns = np.clip(np.arange(width) + moves[1], 0, width - 1)
    b, c = np.arange(batch)[:, None, None, None], np.arange(cameras)[None, :, None, None]
    moved: NDArray[np.uint8] = frames[b, c, rows[..., :, None], columns[..., None, :]]
    return moved


def add_noise(frames: NDArray[np.uint8], std: float, rng: np.random.Generator) -> torch.Tensor:
    """Add Gaussian noise to frames as recorded: a binary view gets the same in its three channels.

    A normal deviate for every value would take a sixth of a training step. A random byte is looked up
    in a table of the normal distribution's 256 quantiles instead, scaled to the variance asked for.

    Args:
        frames: (..., C) uint8.
        std: Of the noise, for frames in [0, 1].
        rng: Drawn from once.

    Returns:
        The same shape: uint8 as it was if ``std`` is 0, else float32 around [0, 255].
    """
    if std == 0.0:
        return torch.from_numpy(np.ascontiguousarray(frames))
    words = rng.integers(2**64, size=-(-frames.size // 8), dtype=np.uint64)
    levels = words.view(np.uint8)[: frames.size].reshape(-1, frames.shape[-1])
    noise = cv2.LUT(levels, (255.0 * std * _QUANTILES).astype(np.float32)).reshape(frames.shape)
    noise += frames
    return torch.from_numpy(noise)


def _quantiles() -> NDArray[np.float64]:
    middles = (np.arange(_LEVELS) + 0.5) / _LEVELS
    table = np.array([NormalDist().inv_cdf(middle) for middle in middles])
    scaled: NDArray[np.float64] = table / table.std()
    return scaled


_QUANTILES = _quantiles()
