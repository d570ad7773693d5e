from __future__ import annotations

from itertools import islice
from pathlib import Path

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError
from task_checks import corners_of, hold, third_view

from geoprior.episode import validate_poses
from geoprior.geometry.projection import in_view
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.sim.demos import AttemptTask, record_expert
from geoprior.sim.tasks.close.world import FACING, MIDDLE, OPEN
from geoprior.sim.workers import Setup, environment

SEEDS = range(40)
ARMS = ["ur5e", *(pytest.param(arm, marks=pytest.mark.slow) for arm in ("xarm7", "kinova3"))]


@pytest.fixture(scope="module")
def env(ur5e, cameras):
    return environment(Setup(ur5e, Choice(name="close"), cameras), 10)


def _open(env, angle: float) -> None:
    env.world.put_door(MIDDLE, FACING, angle)
    mujoco.mj_forward(env.world.sim.model._model, env.world.sim.data._data)


def test_door_and_hand_are_in_the_third_view_from_open_to_shut(env):
    view = third_view(env)
    for seed in SEEDS:
        env.reset(seed)
        points = [env.pose()[None, :3], corners_of(env, "door")]
        env.world.sim.data.set_joint_qpos(env.world.door.hinge_joint, 0.0)
        mujoco.mj_kinematics(env.world.sim.model._model, env.world.sim.data._data)
        points.append(corners_of(env, "door"))
        assert in_view(view, np.vstack(points), margin=0.01), seed


@pytest.mark.parametrize("arm", ARMS)
def test_arm_starts_clear_of_the_open_door(arm, cameras):
    env = environment(Setup(Choice(name=arm), Choice(name="close"), cameras), 10)
    model, data = env.world.sim.model._model, env.world.sim.data._data
    body = [model.body(number).name for number in model.geom_bodyid]
    door = [geom for geom, name in enumerate(body) if name.startswith("door") and model.geom_contype[geom]]
    margin = model.geom_margin[door].copy()
    for seed in SEEDS:
        env.reset(seed)
        model.geom_margin[door] = 0.01
        mujoco.mj_forward(model, data)
        pairs = [{body[contact.geom1], body[contact.geom2]} for contact in data.contact]
        model.geom_margin[door] = margin
        of_door = [pair for pair in pairs if any(name.startswith("door") for name in pair)]
        assert not [
            pair for pair in of_door if any(name.startswith(("robot", "gripper")) for name in pair)
        ], seed


def test_door_covers_its_ranges_and_starts_open(env):
    config = env.task.config
    handles, yaws, angles = [], [], []
    for seed in SEEDS:
        env.reset(seed)
        handle, angle = env.world.transform_handle_to_workspace(), env.world.hinge_angle()
        handles.append(handle[:3, 3])
        yaws.append(np.arctan2(-handle[1, 0], -handle[0, 0]) - angle)
        angles.append(angle)
        assert not env.world.succeeded()
        assert env.world.failure() == ""
    assert np.ptp(handles, axis=0)[0] > 1.5 * config.range_x
    assert np.ptp(handles, axis=0)[1] > 1.5 * config.range_y
    assert 1.5 * np.radians(config.range_yaw) < np.ptp(yaws) <= 2.0 * np.radians(config.range_yaw)
    assert 1.5 * config.range_angle < np.ptp(angles)
    assert np.abs(np.array(angles) - OPEN).max() <= config.range_angle


@pytest.mark.parametrize(("angle", "shut"), [(0.0, True), (0.025, True), (0.035, False), (0.45, False)])
def test_angle_of_the_hinge_decides(env, angle, shut):
    env.reset(0)
    _open(env, angle)
    assert env.world.hinge_angle() == angle
    assert env.world.succeeded() == shut


def test_door_left_ajar_stays_so_and_does_not_count(env):
    env.reset(0)
    _open(env, 0.06)
    hold(env, 10)
    assert abs(env.world.hinge_angle() - 0.06) < 0.005
    assert not env.world.succeeded()


def test_unusable_options_are_refused():
    config = plugins().spec("task", "close").config
    for option in ({"range_x": 0.2}, {"range_angle": 0.5}, {"angle": 0.3}, {"angle": 0.0}):
        with pytest.raises(ValidationError):
            config(**option)


def test_door_keeps_shut_when_the_hand_goes_away(env):
    env.reset(1)
    angles = []
    for command in env.expert(seed=0):
        env.step(command)
        angles.append(env.world.hinge_angle())
    assert min(angles) > -0.03
    assert env.world.succeeded()
    away = env.pose()
    away[1] += 0.15
    for _ in range(10):
        env.step(away)
    assert np.linalg.norm(env.pose()[:3] - away[:3]) < 0.03
    assert env.world.succeeded()


def test_demonstrations_vary_from_the_first_move(env):
    env.reset(0)
    first, second = (np.array(list(islice(env.expert(seed), 8))) for seed in (0, 1))
    assert np.abs(first[-1, :3] - second[-1, :3]).max() > 0.002


def test_demonstration_succeeds_and_obeys_the_contract(env, cameras):
    setup = Setup(Choice(name="ur5e"), Choice(name="close"), cameras)
    episode, reason, steps = record_expert(env, AttemptTask(0, 0, setup, 10, 0, Path("unused")))
    assert episode is not None, reason
    episode.validate()
    validate_poses(episode.header, "action", episode.action)
    assert set(episode.action[:, 7]) == {1.0}
    assert steps < 80
