"""The projection kernel. Importing this module imports numba; the first call compiles.

Two loops a frame: one without branches that the compiler turns into vector instructions, and one that
writes the pixels. No fast-math: a reassociated sum could move a pixel, and with it the bytes of a data set.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numba
import numpy as np

from geoprior.geometry.projection import NEAREST

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

Function = TypeVar("Function", bound="Callable[..., None]")


def compiled(function: Function) -> Function:
    """Compile, and keep the machine code on disk where numba finds a folder that it can write to."""
    njit: Any = numba.njit
    options = {"error_model": "numpy", "nogil": True}
    try:
        machine_code: Function = njit(cache=True, **options)(function)
    except RuntimeError:  # numba: no locator available for the cache
        machine_code = njit(**options)(function)
    return machine_code


@compiled
def _project(
    matrix: NDArray[np.float64],
    points: NDArray[np.float64],
    size: tuple[int, int],
    footprint: int,
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
        level = (depth > NEAREST) & (top > outside) & (top < height)
        seen = level & (left > outside) & (left < width)
        rows[p] = np.int32(np.floor(top if seen else outside))
        columns[p] = np.int32(np.floor(left if seen else outside))


@compiled
def _stamp(frame: NDArray[np.uint8], corners: NDArray[np.int32], footprint: int) -> None:
    """Set the footprint below and to the right of every corner to 255, cut off at the frame's edges."""
    height, width = frame.shape
    for p in range(corners.shape[1]):
        row, column = corners[0, p], corners[1, p]
        if footprint == 2 and 0 <= row < height - 1 and 0 <= column < width - 1:
            frame[row, column] = 255
            frame[row, column + 1] = 255
            frame[row + 1, column] = 255
            frame[row + 1, column + 1] = 255
            continue
        for at_row in range(max(row, 0), min(row + footprint, height)):
            for at_column in range(max(column, 0), min(column + footprint, width)):
                frame[at_row, at_column] = 255


@compiled
def draw(
    frames: NDArray[np.uint8], matrices: NDArray[np.float64], points: NDArray[np.float64], footprint: int
) -> None:
    """Draw points into every frame.

    Args:
        frames: (N, H, W), drawn into.
        matrices: (N, 3, 4) from the points' frame to homogeneous pixels.
        points: (3, P), one row an axis.
        footprint: Side of the square that a point covers, pixels.
    """
    corners = np.empty((2, points.shape[1]), np.int32)
    for n in range(len(frames)):
        _project(matrices[n], points, (frames.shape[1], frames.shape[2]), footprint, corners)
        _stamp(frames[n], corners, footprint)
