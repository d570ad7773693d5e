"""What holds for place and push alike: where cube and goal lie at the start of an episode."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError

from geoprior.geometry.projection import View, in_view
from geoprior.geometry.se3 import apply, invert
from geoprior.hooks.manager import plugins
from geoprior.sim.worlds.tabletop import TABLE_TOP

SEEDS = range(100)
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


@pytest.fixture(params=["place", "push"])
def env(request):
    return request.getfixturevalue(f"{request.param}_env")


def _corners(env, body: str) -> np.ndarray:
    """Corners (P, 3) in the workspace of the boxes around all that is drawn of a body."""
    model, data = env.world.sim.model._model, env.world.sim.data._data
    geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == model.body(body).id]
    boxes = [
        (model.geom_aabb[geom, :3] + CORNERS * model.geom_aabb[geom, 3:])
        @ data.geom_xmat[geom].reshape(3, 3).T
        + data.geom_xpos[geom]
        for geom in geoms
        if model.geom_group[geom] == 1
    ]
    return np.concatenate(boxes) - TABLE_TOP


def _third_view(env) -> View:
    header = next(header for header in env.camera_headers() if header.name == "third")
    to_camera = invert(np.array(header.transform_camera_to_mount))
    return View(to_camera, np.array(header.intrinsics), header.height, header.width)


def test_cube_and_goal_are_in_the_third_view_and_clear_of_the_hand(env):
    view = _third_view(env)
    for seed in SEEDS:
        env.reset(seed)
        cube, goal = (_corners(env, each.root_body) for each in (env.world.cube, env.world.goal))
        assert cube.shape == (8, 3)
        assert in_view(view, np.vstack([cube, goal]), margin=0.01), seed
        assert env.pose()[2] - max(cube[:, 2].max(), goal[:, 2].max()) > 0.15


def test_cube_and_goal_cover_their_range_apart_from_each_other(env):
    config = env.task.config
    cubes, goals, yaws = [], [], []
    for seed in SEEDS:
        env.reset(seed)
        goal = env.world.transform_goal_to_workspace()
        cubes.append(env.world.cube_position())
        goals.append(goal[:3, 3])
        yaws.append([env.world.cube_yaw(), np.arctan2(goal[1, 0], goal[0, 0])])
        assert env.world.failure() == ""
    cubes, goals = np.array(cubes), np.array(goals)
    np.testing.assert_allclose(cubes[:, 2], 0.021, atol=1e-9)
    np.testing.assert_allclose(goals[:, 2], 0.0, atol=1e-9)
    assert np.linalg.norm((cubes - goals)[:, :2], axis=1).min() >= config.gap
    for places in (cubes, goals):
        assert (np.ptp(places[:, :2], axis=0) > [1.8 * config.range_x, 1.8 * config.range_y]).all()
        assert (np.ptp(places[:, :2], axis=0) <= [2.0 * config.range_x, 2.0 * config.range_y]).all()
    # The way from one to the other goes anywhere: no demonstration fits another episode.
    ways = (goals - cubes)[:, :2]
    assert np.ptp(ways, axis=0).min() > 0.25
    assert np.ptp(yaws, axis=0).min() > 5.5


def test_initial_state_is_a_function_of_its_seed(env):
    def state(seed: int) -> np.ndarray:
        env.reset(seed)
        data = env.world.sim.data
        return np.concatenate([data.qpos, data.qvel, data.mocap_pos.ravel(), data.mocap_quat.ravel()])

    first = state(5)
    for command in list(env.expert(seed=0))[:5]:
        env.step(command)
    assert not np.array_equal(state(6), first)
    np.testing.assert_array_equal(state(5), first)


def test_goal_frame_lies_on_the_table_and_turns_with_the_goal(env):
    env.reset(0)
    env.world.put_goal(np.array([0.05, -0.1]), 0.5)
    env.world.put_cube(np.array([0.1, 0.02]), 0.0)
    mujoco.mj_forward(env.world.sim.model._model, env.world.sim.data._data)
    goal = env.world.transform_goal_to_workspace()
    np.testing.assert_allclose(apply(goal, np.zeros((1, 3)))[0], [0.05, -0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(goal[:3, 0], [np.cos(0.5), np.sin(0.5), 0.0], atol=1e-12)
    back = apply(goal, env.world.cube_in_goal_frame()[None])[0]
    np.testing.assert_allclose(back, [0.1, 0.02, 0.021], atol=1e-12)


@pytest.mark.parametrize("task", ["place", "push"])
def test_range_without_room_for_the_gap_is_refused(task):
    config = plugins().spec("task", task).config
    with pytest.raises(ValidationError, match="leave no room for a gap"):
        config(range_x=0.05, range_y=0.05)
    assert config(range_x=0.0, range_y=0.15).range_x == 0.0
