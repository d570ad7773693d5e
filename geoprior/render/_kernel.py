"""The projection kernel. Importing this module imports numba; the first call compiles.

Two loops a frame: one without branches that the compiler turns into vector instructions, and one that sets
the pixels, one bit each, in 64-bit words. A frame of 128 x 128 is then 2 KiB, and stays in the first cache.
No fast-math: a reassociated sum could move a pixel, and with it the bytes of a data set.

In memory a word holds 64 neighbouring pixels of a row as PNG and `numpy.packbits` want them: byte after
byte, the leftmost pixel in the highest bit. Pixel c is thus bit ``(c % 64) ^ 7`` of a little-endian word.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np

from geoprior.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

assert sys.byteorder == "little", "frames are packed for little-endian machines"
WORD = 64


def word_masks(footprint: int) -> NDArray[np.uint64]:
    """Bits that a run of ``footprint`` pixels sets: (64, 2), by its first pixel, in its word and the next."""
    pixels = np.arange(WORD)[:, None] + np.arange(footprint)
    bits = np.uint64(1) << ((pixels % WORD) ^ 7).astype(np.uint64)
    here = np.where(pixels < WORD, bits, np.uint64(0))
    return np.stack([np.bitwise_or.reduce(part, axis=1) for part in (here, bits - here)], axis=1)


@compiled
def _project(
    matrix: NDArray[np.float64],
    points: NDArray[np.float64],
    size: tuple[int, int],
    footprint: int,
    nearest: float,
    corners: NDArray[np.int32],
) -> None:
    """Find the top left pixel (row, column) of every point, (2, P); an unseen one gets -footprint - 1."""
    a, b, c, d = matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[0, 3]
    e, f, g, h = matrix[1, 0], matrix[1, 1], matrix[1, 2], matrix[1, 3]
    i, j, k, m = matrix[2, 0], matrix[2, 1], matrix[2, 2], matrix[2, 3]
    height, width = size
    shift = 1.0 - 0.5 * footprint
    outside = -1.0 - footprint
    xs, ys, zs = points[0], points[1], points[2]
    rows, columns = corners[0], corners[1]
    for p in range(xs.size):
        x, y, z = xs[p], ys[p], zs[p]
        depth = i * x + j * y + k * z + m
        scale = 1.0 / depth
        left = (a * x + b * y + c * z + d) * scale + shift
        top = (e * x + f * y + g * z + h) * scale + shift
        level = (depth > nearest) & (top > outside) & (top < height)
        seen = level & (left > outside) & (left < width)
        rows[p] = np.int32(np.floor(top if seen else outside))
        columns[p] = np.int32(np.floor(left if seen else outside))


@compiled
def _set(frame: NDArray[np.uint64], row: int, rows: int, word: int, bits: np.uint64) -> None:
    for at in range(max(row, 0), min(row + rows, len(frame))):
        frame[at, word] |= bits


@compiled
def _stamp(
    frame: NDArray[np.uint64],
    corners: NDArray[np.int32],
    width: int,
    footprint: int,
    masks: NDArray[np.uint64],
) -> None:
    """Set the footprint below and to the right of every corner, cut off at the frame's edges."""
    words = frame.shape[1]
    for p in range(corners.shape[1]):
        row, column = corners[0, p], corners[1, p]
        if row <= -footprint or column <= -footprint:
            continue
        if column < 0:  # its last pixels are the next word's of one that begins in a word on the left
            _set(frame, row, footprint, 0, masks[column + WORD, 1])
            continue
        word, bit = column >> 6, column & 63
        _set(frame, row, footprint, word, masks[bit, 0])
        if masks[bit, 1] != 0 and word + 1 < words:
            _set(frame, row, footprint, word + 1, masks[bit, 1])
    if width % WORD != 0:
        _clear_beyond(frame, width)


@compiled
def _clear_beyond(frame: NDArray[np.uint64], width: int) -> None:
    inside = np.uint64(0)
    for column in range(width % WORD):
        inside |= np.uint64(1) << np.uint64(column ^ 7)
    for at in range(len(frame)):
        frame[at, frame.shape[1] - 1] &= inside


@compiled
def draw(
    frames: NDArray[np.uint64],
    width: int,
    matrices: NDArray[np.float64],
    points: NDArray[np.float64],
    footprint: int,
    masks: NDArray[np.uint64],
    nearest: float,
) -> None:
    """Draw points into every frame.

    Args:
        frames: (N, H, ceil(width / 64)) words, drawn into.
        width: Columns of a frame, pixels.
        matrices: (N, 3, 4) from the points' frame to homogeneous pixels.
        points: (3, P), one row an axis.
        footprint: Side of the square that a point covers, pixels.
        masks: See `word_masks`.
        nearest: Points are drawn from this depth on, metres.
    """
    corners = np.empty((2, points.shape[1]), np.int32)
    for n in range(len(frames)):
        _project(matrices[n], points, (frames.shape[1], width), footprint, nearest, corners)
        _stamp(frames[n], corners, width, footprint, masks)
