"""Targets: what a synthetic episode knows of its geometry beyond poses, for a policy to learn on the side.

A target is a number at each time step, named ``POINT.FRAME.AXIS``: where a point is in the frame of a hand,
in metres, or in the image of a camera, in half-frames: 0 is the middle, -1 and 1 are the edges.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.episode import HAND_AXES, IMAGE_AXES
from geoprior.geometry.projection import NEAREST
from geoprior.geometry.se3 import apply, invert
from geoprior.scene.objects import OBJECT

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from geoprior.geometry.projection import View
    from geoprior.motions.trajectory import Trajectory
    from geoprior.render.clouds import Shot

    FloatArray = NDArray[np.float64]

POINTS = (OBJECT, "marker")


def target_names(hands: Sequence[str], cameras: Sequence[str]) -> tuple[str, ...]:
    """Names of the T targets of `compute_targets`: those of each point in each hand, then in each camera."""
    frames = [(hand, HAND_AXES) for hand in hands] + [(camera, IMAGE_AXES) for camera in cameras]
    return tuple(f"{point}.{frame}.{axis}" for point in POINTS for frame, axes in frames for axis in axes)


def compute_targets(trajectory: Trajectory, shots: Mapping[str, Shot]) -> NDArray[np.float32]:
    """The targets of an episode.

    Args:
        trajectory: Its hands, object and marker, N time steps.
        shots: Of its cameras, by name in alphabetical order.

    Returns:
        (N, T) float32, named by `target_names`. NaN where there is none: there is no marker, or the point is
        not before the camera. A point outside the frame but before the camera has a place beyond the edge.
    """
    columns = []
    for position in _positions(trajectory):
        for way in trajectory.hands.values():
            columns.append(_inside(invert(way.transforms_hand_to_world), position))
        columns += [_in_image(shot.view, position) for shot in shots.values()]
    return np.hstack(columns).astype(np.float32)


def _positions(trajectory: Trajectory) -> list[FloatArray]:
    """(N, 3) world, metres, of each of `POINTS`; NaN where it is not there."""
    steps, marker = trajectory.steps, trajectory.marker_points
    middle = np.full(3, np.nan) if marker is None else marker.mean(axis=0)
    return [trajectory.transforms_object_to_world[:, :3, 3], np.tile(middle, (steps, 1))]


def _inside(transforms_world_to_frame: FloatArray, positions: FloatArray) -> FloatArray:
    """(N, 3) positions in a frame that rests, (4, 4), or moves, (N, 4, 4)."""
    return apply(transforms_world_to_frame, positions[:, None])[:, 0]


def _in_image(view: View, positions: FloatArray) -> FloatArray:
    """(N, 2) half-frames of the pinhole equations; NaN where the depth is that of nothing that is drawn."""
    seen = _inside(view.transforms_world_to_camera, positions)
    depths = np.where(seen[:, 2:] > NEAREST, seen[:, 2:], np.nan)
    pixels = (seen @ view.intrinsics.T)[:, :2] / depths
    size = np.array([view.width, view.height])
    return np.asarray((2.0 * pixels + 1.0) / size - 1.0)
