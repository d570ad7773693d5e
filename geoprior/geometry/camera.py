"""Pinhole cameras. A camera looks along its +z axis, +x is right in the image and +y is down."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior.options import Options

if TYPE_CHECKING:
    from numpy.typing import NDArray


class CameraConfig(Options):
    """One camera's lens."""

    vertical_fov: float = Field(60.0, gt=1.0, lt=170.0, description="Vertical field of view in degrees.")


class CamerasConfig(Options):
    """The views that the synthetic data, the demonstrations and the rollouts share."""

    height: int = Field(96, ge=16, le=2160, description="Rows of every frame, in pixels.")
    width: int = Field(96, ge=16, le=3840, description="Columns of every frame, in pixels.")
    hand: CameraConfig = Field(default=CameraConfig(vertical_fov=75.0), description="The camera in a hand.")
    third: CameraConfig = Field(
        default=CameraConfig(vertical_fov=50.0), description="The camera that watches the scene."
    )


def pinhole_intrinsics(height: int, width: int, vertical_fov: float) -> NDArray[np.float64]:
    """The (3, 3) matrix of a pinhole camera with square pixels, centred.

    Args:
        height: Rows.
        width: Columns.
        vertical_fov: Degrees.

    Returns:
        ``K`` in pixels, with pixel centres at integer coordinates: the principal point is
        ``((width - 1) / 2, (height - 1) / 2)``.
    """
    focal = 0.5 * height / math.tan(math.radians(vertical_fov) / 2.0)
    return np.array([[focal, 0.0, (width - 1) / 2.0], [0.0, focal, (height - 1) / 2.0], [0.0, 0.0, 1.0]])
