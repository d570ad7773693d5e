"""Views: a pinhole camera at one pose or at many, and which points it has in its frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.se3 import apply

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

NEAREST = 0.01
"""Metres before the camera: points nearer than this, or behind it, are not drawn."""


@dataclass(frozen=True)
class View:
    """A camera's lens, its frame and where it is.

    Attributes:
        transforms_world_to_camera: (4, 4) of a fixed camera, or (N, 4, 4) of one that moves; the camera
            looks along its +z axis, +x is right in the image and +y down.
        intrinsics: (3, 3) pinhole matrix in pixels, pixel centres at whole numbers.
        height: Rows.
        width: Columns.
    """

    transforms_world_to_camera: FloatArray
    intrinsics: FloatArray
    height: int
    width: int


def project(
    points: FloatArray, transform_world_to_camera: FloatArray, intrinsics: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The pinhole equations.

    Args:
        points: (P, 3) world, metres.
        transform_world_to_camera: (4, 4).
        intrinsics: (3, 3).

    Returns:
        (P, 2) pixels as (column, row), without meaning where the depth is not positive; and (P,) depths.
    """
    seen = apply(transform_world_to_camera, points)
    depth = seen[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = (seen @ intrinsics.T)[:, :2] / depth[:, None]
    return pixels, depth


def in_view(view: View, points: FloatArray, margin: float = 0.0) -> bool:
    """Whether a fixed view has all of the points in its frame.

    Args:
        view: A fixed camera.
        points: (P, 3) world, metres. For a convex solid its vertices are enough.
        margin: Distance to keep from the frame's edges, in frame heights, so that the answer is the same
            at every resolution of one shape.
    """
    pixels, depth = project(points, view.transforms_world_to_camera, view.intrinsics)
    low = margin * view.height - 0.5
    high = np.array([view.width, view.height]) - 1.0 - low
    return bool(np.all(depth > NEAREST) and np.all(pixels >= low) and np.all(pixels <= high))
