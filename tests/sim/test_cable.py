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
from geoprior.sim.tasks.cable.small_cable import (
    LARGEST_BEND,
    PLUG_HALF_SIZE,
    SEGMENT_LENGTH,
    SEGMENTS,
    outline,
)
from geoprior.sim.workers import Setup, environment
from geoprior.sim.worlds.tabletop import TABLE_TOP

SEEDS = range(40)
AREA = np.array([-0.02, 0.10])
STRAIGHT = np.zeros(SEGMENTS)
LENGTH = SEGMENTS * SEGMENT_LENGTH


@pytest.fixture(scope="module")
def env(ur5e, cameras):
    return environment(Setup(ur5e, Choice(name="cable"), cameras), 10)


@pytest.fixture
def world(env):
    """The area aside, and the hand far above it."""
    env.reset(0)
    env.world.put_area(AREA)
    return env.world


def _lay(world, offset: tuple[float, float], lift: float = 0.0) -> None:
    """Put the plug beside the area's middle, and a straight cable behind it."""
    model, data = world.sim.model._model, world.sim.data._data
    world.put_cable(AREA + offset, 0.7, STRAIGHT)
    data.joint(world.cable.joints[0]).qpos[2] += lift
    mujoco.mj_forward(model, data)


def _joints(world) -> np.ndarray:
    """(SEGMENTS, 3) the ball joints in the workspace frame, the plug's first."""
    data, model = world.sim.data._data, world.sim.model._model
    return np.array([data.xanchor[model.joint(name).id] for name in world.cable.ball_joints]) - TABLE_TOP


def test_cable_area_and_hand_are_in_the_third_view(env):
    view = third_view(env)
    for seed in SEEDS:
        env.reset(seed)
        points = [corners_of(env, "cable"), corners_of(env, "area"), env.pose()[None, :3]]
        assert in_view(view, np.vstack(points), margin=0.01), seed
        assert points[0][:, 2].min() > -0.001
        assert points[0][:, 2].max() < env.pose()[2] - 0.1
        assert not env.world.succeeded()
        assert env.world.failure() == ""


def test_cable_covers_its_range_bent_and_apart_from_the_area(env):
    config = env.task.config
    plugs, areas, yaws, chords = [], [], [], []
    for seed in SEEDS:
        env.reset(seed)
        plug, joints = env.world.transform_plug_to_workspace(), _joints(env.world)
        area = plug[:2, 3] - env.world.plug_from_area()[:2]
        plugs.append(plug[:2, 3])
        areas.append(area)
        yaws.append(np.arctan2(plug[1, 0], plug[0, 0]))
        chords.append(np.linalg.norm(joints[-1] - joints[0]) / (LENGTH - SEGMENT_LENGTH))
        assert np.linalg.norm(joints[:, :2] - area, axis=1).min() > config.radius
    assert np.linalg.norm(np.subtract(plugs, areas), axis=1).min() >= config.gap
    for places in (plugs, areas):
        assert (np.ptp(places, axis=0) > 1.5 * np.array([config.range_x, config.range_y])).all()
        assert (np.ptp(places, axis=0) <= 2.0 * np.array([config.range_x, config.range_y])).all()
    assert np.histogram(yaws, bins=4, range=(-np.pi, np.pi))[0].min() > 3
    assert 0.8 < min(chords) < 0.95 < max(chords) <= 1.0


def test_outline_is_where_the_cable_lies(env):
    env.reset(0)
    bends = np.linspace(-0.05, 0.2, SEGMENTS)
    env.world.put_cable(np.array([0.02, -0.05]), 2.0, bends)
    mujoco.mj_forward(env.world.sim.model._model, env.world.sim.data._data)
    joints = _joints(env.world)
    np.testing.assert_allclose(joints[:, :2], outline(np.array([0.02, -0.05]), 2.0, bends)[:-1], atol=1e-9)
    np.testing.assert_allclose(joints[:, 2], 0.005, atol=1e-9)


def test_bent_cable_lies_still(env):
    env.reset(1)
    before = _joints(env.world)
    hold(env, 10)
    assert np.linalg.norm(_joints(env.world) - before, axis=1).max() < 0.001
    assert env.world.object_at_rest(env.world.cable)


def test_thrown_cable_neither_explodes_nor_stretches_and_comes_to_rest(env, world):
    """Whirled and thrown harder than any hand would, it keeps its length and soon lies on the table."""
    model, data = world.sim.model._model, world.sim.data._data
    _lay(world, (0.0, -0.1), lift=0.15)
    data.joint(world.cable.joints[0]).qvel[:] = [0.0, 0.0, 1.5, 5.0, 5.0, -20.0]
    for name in world.cable.ball_joints:
        data.joint(name).qvel[:] = [2.0, -2.0, 1.0]
    command, course = env.pose(), [_joints(world)]
    for _ in range(15):
        env.step(command)
        mujoco.mj_kinematics(model, data)
        course.append(_joints(world))
    gaps = np.linalg.norm(np.diff(course, axis=1), axis=2)
    np.testing.assert_allclose(gaps, SEGMENT_LENGTH, atol=1e-9)
    moved = np.linalg.norm(np.diff(course, axis=0), axis=2).max(axis=1)
    assert 0.05 < moved[0] < 0.6
    assert moved[-1] < 0.003
    assert -0.001 < course[-1][:, 2].min() <= course[-1][:, 2].max() < 0.04


def test_cable_cannot_fold_under_its_plug(env, world):
    """Bent too sharply at its first joint, it springs back to what a joint allows."""
    world.put_cable(AREA, 0.7, np.array([1.6, *STRAIGHT[1:]]))
    hold(env, 5)
    turn = world.sim.data.get_joint_qpos(world.cable.ball_joints[0])[0]
    assert 2.0 * np.arccos(abs(turn)) < LARGEST_BEND + 0.05


@pytest.mark.parametrize(
    ("offset", "lift", "speed", "counts"),
    [
        ((0.0, 0.0), 0.0, 0.0, True),
        ((0.025, -0.025), 0.0, 0.0, True),
        ((0.03, 0.03), 0.0, 0.0, False),
        ((0.0, 0.0), 0.006, 0.0, False),
        ((0.0, 0.0), 0.0, 0.05, False),
    ],
    ids=["middle", "within", "beside", "above", "moving"],
)
def test_plug_that_lies_in_the_area_counts(world, offset, lift, speed, counts):
    _lay(world, offset, lift)
    world.sim.data._data.joint(world.cable.joints[0]).qvel[0] = speed
    assert world.succeeded() == counts
    assert world.failure() == ""


def test_plug_off_the_table_is_dropped(world):
    _lay(world, (0.0, 0.9), lift=-0.3)
    assert world.failure() == "dropped"


def test_cable_bends_in_the_hand_and_counts_only_once_it_is_let_go(env):
    env.reset(2)
    held, let_go, chords, heights = [], [], [], []
    for command in env.expert(seed=0):
        env.step(command)
        joints = _joints(env.world)
        chords.append(np.linalg.norm(joints[-1] - joints[0]) / (LENGTH - SEGMENT_LENGTH))
        heights.append(env.world.plug_clearance())
        if env.world.plug_in_area():
            (held if env.world.object_in_hand(env.world.cable) else let_go).append(env.world.succeeded())
    assert max(heights) > 0.04
    assert min(chords) < 0.9 * chords[0]
    assert held
    assert not any(held)
    assert let_go[-1]
    assert env.world.plug_clearance() > -0.001


def test_demonstrations_vary_from_the_first_move(env):
    env.reset(0)
    first, second = (np.array(list(islice(env.expert(seed), 8))) for seed in (0, 1))
    assert np.abs(first[-1, :3] - second[-1, :3]).max() > 0.002


@pytest.mark.slow
def test_demonstrations_succeed_and_obey_the_contract(env, cameras):
    for number in (0, 1):
        setup = Setup(Choice(name="ur5e"), Choice(name="cable"), cameras)
        task = AttemptTask(number, number, setup, 10, 0, Path("unused"))
        episode, reason, steps = record_expert(env, task)
        assert episode is not None, (number, reason)
        episode.validate()
        validate_poses(episode.header, "action", episode.action)
        assert set(episode.action[:, 7]) == {0.0, 1.0}
        assert steps < 130


@pytest.mark.slow
def test_narrowest_range_leaves_room_for_the_widest_gap_and_area(ur5e, cameras):
    options = {"range_x": 0.0, "range_y": 0.10, "gap": 0.16, "radius": 0.05, "bend": 120.0}
    env = environment(Setup(ur5e, Choice(name="cable", options=options), cameras), 10)
    for seed in range(5):
        env.reset(seed)


def test_unusable_options_are_refused():
    config = plugins().spec("task", "cable").config
    for option in ({"range_x": 0.2}, {"range_y": 0.0}, {"gap": 0.05}, {"bend": 300.0}, {"radius": 0.2}):
        with pytest.raises(ValidationError):
            config(**option)
    assert config().gap > config().radius + PLUG_HALF_SIZE[0]
