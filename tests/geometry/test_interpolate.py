"""Interpolation: end points, the paper's SLERP formula, and the degenerate directions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from geoprior.geometry.interpolate import bezier, lerp, rotations_about, slerp, swing, swing_frames

TIMES = np.linspace(0.0, 1.0, 23)
seeds = st.integers(0, 2**32 - 1)


def random_rotation(rng):
    return Rotation.from_quat(rng.normal(size=4)).as_matrix()


def random_direction(rng):
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def assert_rotations(rotations):
    np.testing.assert_allclose(
        rotations @ np.swapaxes(rotations, -1, -2), np.broadcast_to(np.eye(3), rotations.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0, atol=1e-12)


@given(seeds)
def test_forward_follows_the_papers_slerp_formula(seed):
    rng = np.random.default_rng(seed)
    start, forward = random_rotation(rng), random_direction(rng)
    frames = swing_frames(start, forward, TIMES)
    theta = np.arccos(np.clip(start[:, 2] @ forward, -1.0, 1.0))
    expected = (
        np.sin((1.0 - TIMES) * theta)[:, None] * start[:, 2] + np.sin(TIMES * theta)[:, None] * forward
    ) / np.sin(theta)
    np.testing.assert_allclose(frames[:, :, 2], expected, atol=1e-9)
    assert_rotations(frames)


@given(seeds)
def test_right_and_up_are_carried_without_a_twist(seed):
    rng = np.random.default_rng(seed)
    frames = swing_frames(random_rotation(rng), random_direction(rng), np.linspace(0.0, 1.0, 400))
    steps = np.swapaxes(frames[:-1], -1, -2) @ frames[1:]
    turns = Rotation.from_matrix(steps).as_rotvec()
    assert np.abs(turns[:, 2]).max() < 1e-9, "a turn about forward itself"
    assert np.linalg.norm(turns, axis=1).max() <= np.pi / 399 + 1e-9, "a jump"


@pytest.mark.parametrize("seed", range(50))
def test_opposite_forwards_turn_about_the_right_axis(seed):
    start = random_rotation(np.random.default_rng(seed))
    frames = swing_frames(start, -start[:, 2], TIMES)
    assert_rotations(frames)
    np.testing.assert_allclose(frames[-1, :, 2], -start[:, 2], atol=1e-9)
    np.testing.assert_allclose(frames[:, :, 0], np.broadcast_to(start[:, 0], (23, 3)), atol=1e-9)


@given(seeds, st.floats(-17.0, -1.0).map(lambda power: 10.0**power), st.sampled_from([1.0, -1.0]))
def test_almost_parallel_forwards_turn_at_a_constant_rate_and_arrive(seed, off, sign):
    rng = np.random.default_rng(seed)
    start = random_rotation(rng)
    axis = np.cross(start[:, 2], random_direction(rng))
    forward = Rotation.from_rotvec(off * axis / np.linalg.norm(axis)).apply(sign * start[:, 2])
    frames = swing_frames(start, forward, TIMES)
    assert_rotations(frames)
    np.testing.assert_allclose(frames[-1, :, 2], forward, atol=2e-9)
    turns = Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]).magnitude()
    np.testing.assert_allclose(turns, (off if sign > 0.0 else np.pi - off) / 22, atol=2e-9)


def test_no_turn_between_equal_directions():
    start = random_rotation(np.random.default_rng(3))
    np.testing.assert_allclose(
        swing_frames(start, start[:, 2].copy(), TIMES), start[None].repeat(23, 0), atol=1e-9
    )
    assert swing(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))[1] == 0.0


@given(seeds)
def test_slerp_agrees_with_scipy_and_hits_its_ends(seed):
    rng = np.random.default_rng(seed)
    start, end = random_rotation(rng), random_rotation(rng)
    ours = slerp(start, end, TIMES)
    scipys = Slerp([0.0, 1.0], Rotation.from_matrix(np.stack([start, end])))(TIMES).as_matrix()
    np.testing.assert_allclose(ours, scipys, atol=1e-9)
    np.testing.assert_array_equal(ours[-1], end)
    assert_rotations(ours)


def test_slerp_of_half_a_turn_is_a_rotation_all_the_way():
    start = random_rotation(np.random.default_rng(1))
    ours = slerp(start, start @ np.diag([-1.0, -1.0, 1.0]), TIMES)
    assert_rotations(ours)
    angles = Rotation.from_matrix(start.T @ ours).magnitude()
    np.testing.assert_allclose(angles, np.pi * TIMES, atol=1e-9)


@given(seeds)
def test_rotations_about_agree_with_scipy(seed):
    rng = np.random.default_rng(seed)
    axis, angles = random_direction(rng), rng.uniform(-np.pi, np.pi, 7)
    expected = Rotation.from_rotvec(angles[:, None] * axis).as_matrix()
    np.testing.assert_allclose(rotations_about(axis, angles), expected, atol=1e-12)


@settings(max_examples=25)
@given(seeds)
def test_bezier_is_the_bernstein_sum(seed):
    controls = np.random.default_rng(seed).normal(size=(4, 3))
    t = TIMES[:, None]
    expected = (
        (1 - t) ** 3 * controls[0]
        + 3 * t * (1 - t) ** 2 * controls[1]
        + 3 * t**2 * (1 - t) * controls[2]
        + t**3 * controls[3]
    )
    np.testing.assert_allclose(bezier(controls, TIMES), expected, atol=1e-12)


def test_lerp_is_the_papers_line():
    start, end = np.array([1.0, 2.0, 3.0]), np.array([-1.0, 0.0, 7.0])
    points = lerp(start, end, TIMES)
    np.testing.assert_array_equal(points[0], start)
    np.testing.assert_array_equal(points[-1], end)
    np.testing.assert_allclose(
        np.diff(points, axis=0), np.broadcast_to((end - start) / 22, (22, 3)), atol=1e-12
    )
