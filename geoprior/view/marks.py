"""What a picture in space is drawn with: dots and lines in the world, each with a colour and a strength."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.se3 import apply
from geoprior.view.palette import AXES, CAMERA, Colour

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.view.world import Camera

    FloatArray = NDArray[np.float64]

_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_EDGES = [(i, j) for i in range(8) for j in range(i) if (_CORNERS[i] != _CORNERS[j]).sum() == 1]
_DASHES = 60
_FARTHEST_SIGHT = 3.0


@dataclass(frozen=True)
class Dots:
    """Discs that face the camera.

    Attributes:
        points: (P, 3) world, metres.
        radius: Metres.
        colour: RGB.
        strength: 1 as it is; towards 0 it fades into the ground.
    """

    points: FloatArray
    radius: float
    colour: Colour
    strength: float = 1.0

    @property
    def places(self) -> FloatArray:
        """(P, 3) what must be in a picture that has it whole."""
        return self.points


@dataclass(frozen=True)
class Lines:
    """Straight pieces of line.

    Attributes:
        segments: (S, 2, 3) world, metres.
        width: Pixels in a frame of 600 rows; one at least.
        colour: RGB.
        strength: See `Dots`.
    """

    segments: FloatArray
    width: float
    colour: Colour
    strength: float = 1.0

    @property
    def places(self) -> FloatArray:
        """(P, 3) what must be in a picture that has it whole."""
        return self.segments.reshape(-1, 3)


@dataclass(frozen=True)
class Label:
    """A word beside a point, over everything else.

    Attributes:
        point: (3,) world, metres.
        text: One line.
        colour: RGB.
    """

    point: FloatArray
    text: str
    colour: Colour

    @property
    def places(self) -> FloatArray:
        """(P, 3) what must be in a picture that has it whole."""
        return self.point[None]


Mark = Dots | Lines | Label


def box(transform_box_to_world: FloatArray, size: FloatArray, colour: Colour, strength: float = 1.0) -> Lines:
    """The edges of a box about the origin of its frame; sides (3,) in metres."""
    corners = apply(transform_box_to_world, _CORNERS * size)
    return Lines(corners[_EDGES], 1, colour, strength)


def grid(side: float, height: float, pieces: int, colour: Colour, strength: float) -> Lines:
    """A square of lines about the origin at a height, ``pieces`` times ``pieces`` fields; metres."""
    at = np.linspace(-0.5 * side, 0.5 * side, pieces + 1)
    along = np.stack([np.full_like(at, at[0]), np.full_like(at, at[-1])], axis=1)
    across = np.stack([at, at], axis=1)
    level = np.full_like(along, height)
    segments = [np.stack([along, across, level], axis=-1), np.stack([across, along, level], axis=-1)]
    return Lines(np.concatenate(segments), 1, colour, strength)


def triad(
    transform_hand_to_world: FloatArray, length: float, width: float, strength: float = 1.0
) -> list[Lines]:
    """A frame's axes [right, up, forward], each in its colour; length in metres, width in pixels."""
    origin, rotation = transform_hand_to_world[:3, 3], transform_hand_to_world[:3, :3]
    ends = origin + length * rotation.T
    return [
        Lines(np.stack([origin, end])[None], width, colour, strength)
        for end, colour in zip(ends, AXES.values(), strict=True)
    ]


def frustum(camera: Camera, step: int, depth: float, strength: float = 1.0) -> list[Mark]:
    """What a camera's frame cuts out of the world, up to a depth in metres; a roof marks the top."""
    transforms = camera.transforms_camera_to_world
    transform = transforms[step] if transforms.ndim == 3 else transforms
    rays = depth * camera.rays
    roof = 0.5 * (rays[0] + rays[1]) + 0.25 * (rays[0] - rays[3])
    eye, *corners = apply(transform, np.vstack([np.zeros(3), rays]))
    peak = apply(transform, roof[None])[0]
    ring = [*corners, corners[0]]
    pieces = [*((eye, corner) for corner in corners), *pairwise(ring)]
    pieces += [(corners[0], peak), (peak, corners[1])]
    return [Lines(np.array(pieces), 1, CAMERA, strength), Label(eye, camera.name, CAMERA)]


def sight(camera: Camera, height: float) -> Lines:
    """A fixed camera's line of sight down to the floor at a height; of no length if it looks up."""
    transform = camera.transforms_camera_to_world
    eye, ahead = transform[:3, 3], transform[:3, 2]
    falls = ahead[2] * (height - eye[2]) > 0.0
    length = min((height - eye[2]) / ahead[2], _FARTHEST_SIGHT) if falls else 0.0
    steps = np.linspace(0.0, length, _DASHES)
    points = eye + steps[:, None] * ahead
    return Lines(points.reshape(-1, 2, 3), 1, CAMERA, 0.5)
