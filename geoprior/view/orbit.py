"""A camera that looks at a world from any angle and has all of it in its frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.camera import pinhole_intrinsics
from geoprior.geometry.projection import NEAREST, View
from geoprior.geometry.se3 import apply, invert, look_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

VERTICAL_FOV = 30.0
"""Degrees. Narrow: parallel edges stay nearly so, and depth is still felt."""


@dataclass(frozen=True)
class Angle:
    """Where one looks from.

    Attributes:
        azimuth: About z, from +x, degrees: at 0 the camera stands on the side of +x.
        elevation: Above the horizontal, degrees; 90 is straight down, below 0 is from under the floor.
    """

    azimuth: float = 35.0
    elevation: float = 30.0

    @property
    def outward(self) -> FloatArray:
        """(3,) unit direction from what is looked at to the camera."""
        azimuth, elevation = self._radians
        level = math.cos(elevation)
        return np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])

    @property
    def up(self) -> FloatArray:
        """(3,) unit direction that points up in the image, at right angles to `outward` at every angle."""
        azimuth, elevation = self._radians
        level = -math.sin(elevation)
        return np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.cos(elevation)])

    def turned(self, degrees: float) -> Angle:
        """The same elevation, further along the orbit."""
        return replace(self, azimuth=self.azimuth + degrees)

    @property
    def _radians(self) -> tuple[float, float]:
        # A whole turn is the same picture to the last bit.
        return math.radians(self.azimuth % 360.0), math.radians(self.elevation)


def views_around(
    points: FloatArray, angles: list[Angle], size: tuple[int, int], margin: float = 0.04
) -> list[View]:
    """Views from some angles that all have all of the points in their frames, from one distance.

    Args:
        points: (P, 3) world, metres.
        angles: From where; the cameras look at the middle of the points' bounding box.
        size: Rows and columns of the frames.
        margin: Distance to keep from the frames' edges, in frame heights.
    """
    target = 0.5 * (points.min(axis=0) + points.max(axis=0))
    height, width = size
    intrinsics = pinhole_intrinsics(height, width, VERTICAL_FOV)
    half = np.array([0.5 * width, 0.5 * height]) - margin * height
    slopes = half / intrinsics[0, 0]
    distance = max(_distance(points - target, angle, slopes) for angle in angles)
    poses = [look_at(target + distance * angle.outward, target, angle.up) for angle in angles]
    return [View(invert(pose), intrinsics, height, width) for pose in poses]


def _distance(points: FloatArray, angle: Angle, slopes: FloatArray) -> float:
    """How far a camera must stand from the origin for every point to be within the frame's slopes."""
    at_origin = invert(look_at(angle.outward, np.zeros(3), angle.up))
    at_origin[:3, 3] = 0.0
    seen = apply(at_origin, points)
    needed = np.abs(seen[:, :2]) / slopes - seen[:, 2:]
    return max(float(needed.max()), float(-seen[:, 2].min()) + 2.0 * NEAREST)
