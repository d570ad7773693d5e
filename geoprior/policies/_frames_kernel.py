"""Frames to what a trunk sees, in one pass. Importing this module imports numba."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import prange

from geoprior.compiled import shared

if TYPE_CHECKING:
    from numpy.typing import NDArray


@shared
def scale_frames(
    lanes: int,
    pixels: NDArray[np.float32] | NDArray[np.uint8],
    scale: NDArray[np.float32],
    shift: NDArray[np.float32],
    scaled: NDArray[np.float32],
) -> None:
    """Scale and shift each channel; a binary frame's one channel becomes three.

    Args:
        lanes: How many threads share the pixels.
        pixels: (P, 1) or (P, 3), 0 to 255.
        scale: (3,)
        shift: (3,)
        scaled: (P, 3) out.
    """
    count, channels = pixels.shape
    second, third = min(1, channels - 1), channels - 1
    for lane in prange(lanes):
        for pixel in range(lane * count // lanes, (lane + 1) * count // lanes):
            scaled[pixel, 0] = np.float32(pixels[pixel, 0]) * scale[0] + shift[0]
            scaled[pixel, 1] = np.float32(pixels[pixel, second]) * scale[1] + shift[1]
            scaled[pixel, 2] = np.float32(pixels[pixel, third]) * scale[2] + shift[2]
