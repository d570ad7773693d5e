"""Ways from one pose to another: lines, SLERP, and Bézier curves. Times are (N,) in [0, 1]."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.geometry.se3 import cross

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

_PARALLEL = 1e-9
"""Sine of an angle below which two directions count as one line."""


def lerp(start: FloatArray, end: FloatArray, times: FloatArray) -> FloatArray:
    """Points (N, 3) on the straight line from ``start`` to ``end`` (the paper's eq. for p(t))."""
    return (1.0 - times)[:, None] * start + times[:, None] * end


def bezier(controls: FloatArray, times: FloatArray) -> FloatArray:
    """Points (N, 3) of the Bézier curve with control points (K, 3), by de Casteljau's algorithm."""
    points = np.repeat(controls[None], len(times), axis=0)
    weight = times[:, None, None]
    while points.shape[1] > 1:
        points = (1.0 - weight) * points[:, :-1] + weight * points[:, 1:]
    return points[:, 0]


def rotations_about(axis: FloatArray, angles: FloatArray) -> FloatArray:
    """Rotation matrices (N, 3, 3) about a unit axis (3,) by angles (N,), by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross))


def swing(start: FloatArray, end: FloatArray, detour: FloatArray) -> tuple[FloatArray, float]:
    """The least rotation that takes one direction to another.

    Args:
        start: (3,) unit direction.
        end: (3,) unit direction.
        detour: (3,) unit axis across ``start`` to turn about where the two are opposite and every axis
            across them would do; also given back where they are the same.

    Returns:
        The unit axis and the angle in [0, pi].
    """
    normal = cross(start, end)
    sine, cosine = float(np.linalg.norm(normal)), float(start @ end)
    angle = float(np.arctan2(sine, cosine))
    if sine < _PARALLEL:
        return detour, (0.0 if cosine > 0.0 else np.pi)
    return normal / sine, angle


def swing_frames(rotation: FloatArray, forward: FloatArray, times: FloatArray) -> FloatArray:
    """Turn a hand so that its forward axis follows SLERP and right and up are carried along.

    The frame turns as a whole about the axis across both forward directions. Its third column is then the
    paper's SLERP of the forward axis, and right and up stay orthogonal to it by parallel transport: without
    a flip, and without a twist about forward. Opposite directions turn about the hand's right axis.

    Args:
        rotation: (3, 3) start, columns [right, up, forward].
        forward: (3,) unit direction of the last forward axis.
        times: (N,).

    Returns:
        (N, 3, 3).
    """
    axis, angle = swing(rotation[:, 2], forward, detour=rotation[:, 0])
    return rotations_about(axis, angle * times) @ rotation


def slerp(start: FloatArray, end: FloatArray, times: FloatArray) -> FloatArray:
    """Rotations (N, 3, 3) on the shortest way from ``start`` (3, 3) to ``end`` (3, 3)."""
    turn = Rotation.from_matrix(start.T @ end).as_rotvec()
    rotations: FloatArray = start @ Rotation.from_rotvec(times[:, None] * turn).as_matrix()
    rotations[times == 1.0] = end
    return rotations
