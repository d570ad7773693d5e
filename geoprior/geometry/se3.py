"""Rigid transforms as (4, 4) matrices, and the pose vectors that policies see.

`transform_a_to_b` maps coordinates in frame a to coordinates in frame b. The hand frame's columns are
[right, up, forward], right-handed: right = up x forward.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

REFERENCE_QUATERNION = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
"""(x, y, z, w) of a hand that points straight down with its up axis along +x.

The first quaternion of an episode gets the sign that puts it on this one's hemisphere. The working
orientations lie around it; their w is near 0, so a rule on w would flip from frame to frame.
"""


def make_transform(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """Join rotations (..., 3, 3) and positions (..., 3) to transforms (..., 4, 4)."""
    leading = np.broadcast_shapes(rotation.shape[:-2], position.shape[:-1])
    transform = np.zeros((*leading, 4, 4))
    transform[..., :3, :3] = rotation
    transform[..., :3, 3] = position
    transform[..., 3, 3] = 1.0
    return transform


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products (..., 3) of vectors; `numpy.cross` to the bit, and on few vectors five times as fast."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def invert(transform_a_to_b: FloatArray) -> FloatArray:
    """The transforms (..., 4, 4) from b to a."""
    rotation = np.swapaxes(transform_a_to_b[..., :3, :3], -1, -2)
    position = -np.einsum("...ij,...j->...i", rotation, transform_a_to_b[..., :3, 3])
    return make_transform(rotation, position)


def apply(transform_a_to_b: FloatArray, points: FloatArray) -> FloatArray:
    """Map points (..., P, 3) from frame a to frame b with transforms (..., 4, 4)."""
    rotation = np.swapaxes(transform_a_to_b[..., :3, :3], -1, -2)
    return np.asarray(points @ rotation + transform_a_to_b[..., None, :3, 3])


def pose_vectors(transforms_hand_to_workspace: FloatArray, gripper: FloatArray) -> NDArray[np.float32]:
    """Pose vectors ``x, y, z, qx, qy, qz, qw, gripper`` with continuous quaternions.

    Args:
        transforms_hand_to_workspace: (N, 4, 4), metres.
        gripper: (N,) 0 or 1.

    Returns:
        (N, 8) float32.
    """
    quaternions = Rotation.from_matrix(transforms_hand_to_workspace[:, :3, :3]).as_quat()
    positions = transforms_hand_to_workspace[:, :3, 3]
    rows = np.column_stack([positions, continuous_quaternions(quaternions), gripper])
    return rows.astype(np.float32)


def continuous_quaternions(
    quaternions: FloatArray, reference: FloatArray = REFERENCE_QUATERNION
) -> FloatArray:
    """Choose signs so that neighbours, and the first and ``reference``, share a hemisphere.

    Args:
        quaternions: (N, 4) unit quaternions x, y, z, w.
        reference: (4,) what the first one is compared with.

    Returns:
        (N, 4) the same rotations.
    """
    previous = np.vstack([reference, quaternions[:-1]])
    flips = np.where(np.sum(quaternions * previous, axis=1) < 0.0, -1.0, 1.0)
    return np.asarray(quaternions * np.cumprod(flips)[:, None])


def transforms_of_poses(poses: NDArray[np.floating[Any]]) -> FloatArray:
    """Transforms hand to workspace (..., 4, 4) of pose vectors (..., 8); quaternions are normalised."""
    flat = np.asarray(poses, dtype=np.float64).reshape(-1, poses.shape[-1])
    rotation = Rotation.from_quat(flat[:, 3:7]).as_matrix()
    return make_transform(rotation, flat[:, :3]).reshape(*poses.shape[:-1], 4, 4)


def look_at(position: FloatArray, target: FloatArray, up: FloatArray) -> FloatArray:
    """Transform camera to world of a camera that looks at a target.

    Args:
        position: (3,) world, metres.
        target: (3,) world, metres; not at ``position``.
        up: (3,) world direction that shall point up in the image; not along the line of sight.

    Returns:
        (4, 4): the camera looks along +z, +x is right and +y down in the image.
    """
    forward = (target - position) / np.linalg.norm(target - position)
    right = cross(forward, up)
    right /= np.linalg.norm(right)
    down = cross(forward, right)
    return make_transform(np.column_stack([right, down, forward]), position)


TRANSFORM_CAMERA_TO_HAND_AXES = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
"""(3, 3) rotation of a camera that looks along the hand's forward axis with the hand's up axis up.

Seen along forward with up up, the image's right is the hand's *minus* right (right = up x forward points
to the viewer's left), so x and y both change sign.
"""
