"""Push: the paper's equations, and the degenerate push that goes nowhere."""

from __future__ import annotations

import numpy as np
import pytest

from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.se3 import apply
from geoprior.motions.push import push_direction, push_rotation
from geoprior.options import Choice
from geoprior.scene.config import MarkerConfig, SceneConfig
from geoprior.shards.config import GenerateConfig
from geoprior.shards.synthesis import stage_episode


def test_up_is_world_up_and_the_gripper_stays_open(takes):
    for take in takes("push"):
        trajectory = take.trajectory
        np.testing.assert_array_equal(trajectory.gripper, 0.0)
        pushed = trajectory.transforms_hand_to_world[trajectory.phases.index("push") - 1 :]
        moved = trajectory.transforms_object_to_world[-1, :3, 3] - take.scene.object.centre
        direction = moved / np.linalg.norm(moved)
        for frame in pushed:
            np.testing.assert_allclose(frame[:3, 1], [0.0, 0.0, 1.0], atol=1e-9)
            np.testing.assert_allclose(frame[:3, 2], direction, atol=1e-9)
            np.testing.assert_allclose(frame[:3, 0], np.cross([0.0, 0.0, 1.0], direction), atol=1e-9)


def test_hand_and_object_move_on_together_on_a_line_through_both_centres(takes):
    for take in takes("push"):
        trajectory = take.trajectory
        first = trajectory.phases.index("push") - 1
        hand = trajectory.transforms_hand_to_world[first:, :3, 3]
        centre = trajectory.transforms_object_to_world[first:, :3, 3]
        offset = centre - hand
        np.testing.assert_allclose(offset, np.broadcast_to(offset[0], offset.shape), atol=1e-12)
        forward = trajectory.transforms_hand_to_world[-1, :3, 2]
        np.testing.assert_allclose(np.cross(offset[0], forward), 0.0, atol=1e-9)
        steps = np.diff(hand, axis=0)
        np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-12)
        turns = trajectory.transforms_object_to_world[:, :3, :3]
        np.testing.assert_array_equal(turns, np.broadcast_to(turns[0], turns.shape))


def test_the_cube_clears_the_object_by_a_small_gap(takes):
    for take in takes("push"):
        trajectory = take.trajectory
        pose = trajectory.transforms_hand_to_world[trajectory.phases.index("push") - 1]
        cube = apply(pose, take.scene.hand.points) @ pose[:3, 2]
        body = take.scene.object.vertices @ pose[:3, 2]
        assert 0.002 - 1e-9 <= body.min() - cube.max() <= 0.01 + 1e-9


def test_a_push_of_no_distance_has_a_direction_and_stays(takes):
    np.testing.assert_array_equal(push_direction(np.ones(3), np.ones(3)), [1.0, 0.0, 0.0])
    config = GenerateConfig(fps=20, seconds=1, scene=SceneConfig(marker=MarkerConfig(distance=(0.0, 0.0))))
    for index in range(20):
        take = stage_episode(config, CamerasConfig(), 0, Choice(name="push"), index)
        frames = take.trajectory.transforms_hand_to_world
        assert np.isfinite(frames).all()
        np.testing.assert_allclose(frames[-1], frames[10], atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_direction_is_the_horizontal_unit_vector(seed):
    centre, goal = np.random.default_rng(seed).normal(size=(2, 3))
    direction = push_direction(centre, goal)
    assert direction[2] == 0.0
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    np.testing.assert_allclose(np.cross(direction[:2], (goal - centre)[:2]), 0.0, atol=1e-12)
    assert direction @ (goal - centre) > 0.0
    assert np.linalg.det(push_rotation(direction)) == pytest.approx(1.0)
