from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from geoprior.errors import ConfigError, DataError
from geoprior.geometry.se3 import REFERENCE_QUATERNION, apply, invert, transforms_of_poses
from geoprior.sim.environment import Environment, UnstablePhysicsError

CUBE_CORNERS = 0.021 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def _run(env, state_seed: int, steps: int) -> tuple[np.ndarray, list[np.ndarray]]:
    env.reset(state_seed)
    states, frames = [], []
    for command in islice(env.expert(seed=0), steps):
        env.step(command)
        states.append(np.concatenate([env.world.sim.data.qpos, env.world.sim.data.qvel, env.pose()]))
        frames.extend(env.render().values())
    return np.array(states), frames


def _pixels(env, name: str, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Image coordinates (P, 2) and depths (P,) of workspace points, by the episode header's numbers."""
    header = next(header for header in env.camera_headers() if header.name == name)
    to_workspace = np.array(header.transform_camera_to_mount)
    if header.mount != "world":
        to_workspace = transforms_of_poses(env.pose().astype(np.float64)) @ to_workspace
    camera = apply(invert(to_workspace), points)
    image = camera @ np.array(header.intrinsics).T
    return image[:, :2] / image[:, 2:], camera[:, 2]


def test_same_seed_and_commands_give_the_same_bits_after_other_episodes(env):
    states, frames = _run(env, 7, 12)
    _run(env, 8, 30)
    again, frames_again = _run(env, 7, 12)
    np.testing.assert_array_equal(again, states)
    for frame, frame_again in zip(frames, frames_again, strict=True):
        np.testing.assert_array_equal(frame_again, frame)


def test_fresh_environment_agrees_with_a_used_one(env):
    states, frames = _run(env, 7, 6)
    fresh = Environment(env.robot, env.task, env.setting)
    again, frames_again = _run(fresh, 7, 6)
    fresh.close()
    np.testing.assert_array_equal(again, states)
    for frame, frame_again in zip(frames, frames_again, strict=True):
        np.testing.assert_array_equal(frame_again, frame)


def test_initial_states_cover_the_range(env):
    cubes, starts = [], []
    for seed in range(60):
        env.reset(seed)
        cubes.append([*env.world.cube_position(), env.world.cube_yaw()])
        starts.append(env.pose())
    cubes, starts = np.array(cubes), np.array(starts)
    assert np.abs(cubes[:, 0]).max() <= 0.10
    assert np.abs(cubes[:, 1]).max() <= 0.15
    assert np.ptp(cubes[:, 0]) > 0.18
    assert np.ptp(cubes[:, 1]) > 0.27
    assert np.ptp(cubes[:, 3]) > 5.5
    np.testing.assert_allclose(cubes[:, 2], 0.021, atol=1e-9)
    assert np.ptp(starts[:, 0]) > 0.04
    assert (starts[:, 3:7] @ REFERENCE_QUATERNION > 0.9).all()
    assert (starts[:, 7] == 0.0).all()


def test_both_cameras_see_hand_and_cube_from_the_first_frame_on(env):
    size = env.cameras.height
    for seed in range(60):
        env.reset(seed)
        corners = CUBE_CORNERS + env.world.cube_position()
        hand = env.pose()[None, :3].astype(np.float64)
        for name, points in (("third", np.vstack([corners, hand])), ("hand", corners)):
            pixels, depths = _pixels(env, name, points)
            assert depths.min() > 0.05
            assert pixels.min() > 1.0, (name, seed)
            assert pixels.max() < size - 2.0, (name, seed)


def test_frames_agree_with_the_header(env):
    """The pixel where the header's numbers put the cube's middle is red: cameras, rows and colours fit."""
    for seed in (2, 3, 9, 21):
        env.reset(seed)
        frames = env.render()
        for name, frame in frames.items():
            assert frame.shape == (env.cameras.height, env.cameras.width, 3)
            assert frame.dtype == np.uint8
            (column, row), _ = (part[0] for part in _pixels(env, name, env.world.cube_position()[None]))
            red, green, blue = frame[round(row), round(column)].astype(int)
            assert red > 60, (name, seed)
            assert red > 3 * max(green, blue), (name, seed)


def test_poses_follow_the_episode_contract(env):
    env.reset(4)
    poses = []
    for command in env.expert(seed=0):
        poses.append(env.pose())
        env.step(command)
    poses = np.array(poses)
    assert poses.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(poses[:, 3:7], axis=1), 1.0, atol=1e-5)
    assert (np.sum(poses[1:, 3:7] * poses[:-1, 3:7], axis=1) > 0.9).all()
    assert set(poses[:, 7]) == {0.0, 1.0}


def test_quaternion_of_the_command_may_have_either_sign(env):
    env.reset(4)
    command = env.pose()
    command[:3] += [0.02, 0.01, -0.02]
    env.step(command)
    state = env.world.sim.data.qpos.copy()
    env.reset(4)
    command[3:7] *= -1.0
    env.step(command)
    np.testing.assert_allclose(env.world.sim.data.qpos, state, atol=1e-9)


def test_control_rate_must_divide_the_physics(env):
    with pytest.raises(ConfigError, match="control_rate 30"):
        Environment(env.robot, env.task, replace(env.setting, control_rate=30))


def test_a_goal_met_at_the_start_is_refused(env, monkeypatch):
    monkeypatch.setattr(env.world, "succeeded", lambda: True)
    with pytest.raises(DataError, match="seed 12 already counts as success"):
        env.reset(12)


@pytest.mark.parametrize("fault", [np.nan, 1e12])
def test_broken_physics_is_reported_and_survived(env, fault):
    env.reset(1)
    command = env.pose()
    env.world.sim.data.qvel[0] = fault
    with pytest.raises(UnstablePhysicsError):
        env.step(command)
    states, _ = _run(env, 7, 3)
    again, _ = _run(env, 7, 3)
    np.testing.assert_array_equal(again, states)


def test_far_command_is_survived(env):
    env.reset(1)
    command = env.pose()
    command[:3] = [40.0, -3.0, 9.0]
    for _ in range(5):
        env.step(command)
    assert np.isfinite(env.world.sim.data.qpos).all()
