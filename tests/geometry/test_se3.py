"""Rigid transforms: group axioms, and pose vectors that go there and back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geoprior.geometry.se3 import (
    REFERENCE_QUATERNION,
    TRANSFORM_CAMERA_TO_HAND_AXES,
    apply,
    continuous_quaternions,
    invert,
    look_at,
    make_transform,
    pose_vectors,
    transforms_of_poses,
)

seeds = st.integers(0, 2**32 - 1)


def random_transforms(rng, count):
    rotations = Rotation.from_quat(rng.normal(size=(count, 4))).as_matrix()
    return make_transform(rotations, rng.normal(size=(count, 3)))


@given(seeds)
def test_group_axioms(seed):
    a, b, c = random_transforms(np.random.default_rng(seed), 3)
    np.testing.assert_allclose(invert(a) @ a, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(a @ invert(a), np.eye(4), atol=1e-12)
    np.testing.assert_allclose((a @ b) @ c, a @ (b @ c), atol=1e-12)
    np.testing.assert_allclose(invert(a @ b), invert(b) @ invert(a), atol=1e-12)


@given(seeds)
def test_apply_is_the_product_with_homogeneous_points(seed):
    rng = np.random.default_rng(seed)
    transforms, points = random_transforms(rng, 4), rng.normal(size=(4, 5, 3))
    homogeneous = np.concatenate([points, np.ones((4, 5, 1))], axis=-1)
    expected = np.einsum("nij,npj->npi", transforms, homogeneous)[..., :3]
    np.testing.assert_allclose(apply(transforms, points), expected, atol=1e-12)


@given(seeds)
def test_pose_vectors_go_there_and_back(seed):
    rng = np.random.default_rng(seed)
    transforms = random_transforms(rng, 6)
    poses = pose_vectors(transforms, np.array([0.0, 0.0, 1.0, 1.0, 0.0, 1.0]))
    assert poses.dtype == np.float32
    assert poses.shape == (6, 8)
    np.testing.assert_allclose(transforms_of_poses(poses), transforms, atol=1e-5)
    np.testing.assert_array_equal(poses[:, 7], [0, 0, 1, 1, 0, 1])


@given(seeds)
def test_neighbouring_quaternions_share_a_hemisphere(seed):
    rng = np.random.default_rng(seed)
    signs = rng.choice([-1.0, 1.0], size=(30, 1))
    quaternions = rng.normal(size=(30, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    continuous = continuous_quaternions(quaternions)
    assert continuous[0] @ REFERENCE_QUATERNION >= 0.0
    assert np.all(np.sum(continuous[1:] * continuous[:-1], axis=1) >= 0.0)
    np.testing.assert_array_equal(np.abs(continuous), np.abs(quaternions))
    np.testing.assert_array_equal(continuous_quaternions(signs * quaternions), continuous)


def test_reference_is_a_hand_straight_down_with_up_along_x():
    right, up, forward = Rotation.from_quat(REFERENCE_QUATERNION).as_matrix().T
    np.testing.assert_allclose(forward, [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(up, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(right, np.cross(up, forward), atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_look_at_puts_the_target_on_the_axis_and_up_upwards(seed):
    position, target = np.random.default_rng(seed).normal(size=(2, 3))
    to_world = look_at(position, target, np.array([0.0, 0.0, 1.0]))
    seen = apply(invert(to_world), np.stack([target, target + np.array([0.0, 0.0, 0.1])]))
    np.testing.assert_allclose(seen[0], [0.0, 0.0, np.linalg.norm(target - position)], atol=1e-12)
    assert seen[1, 1] < 0.0, "world up must point up in the image, where y points down"
    assert abs(seen[1, 0]) < 1e-12
    np.testing.assert_allclose(np.linalg.det(to_world[:3, :3]), 1.0)


def test_a_camera_on_the_hand_is_right_handed_and_has_the_hands_up_up():
    np.testing.assert_allclose(np.linalg.det(TRANSFORM_CAMERA_TO_HAND_AXES), 1.0)
    down_in_image = TRANSFORM_CAMERA_TO_HAND_AXES @ [0.0, 1.0, 0.0]
    np.testing.assert_array_equal(down_in_image, [0.0, -1.0, 0.0])
