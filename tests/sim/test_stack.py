from __future__ import annotations

from itertools import islice

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation
from task_checks import corners_of, demonstrate, hold, third_view

from geoprior.geometry.projection import in_view
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.sim.workers import Setup, environment
from geoprior.sim.worlds.cube import CUBE_HALF_SIZE
from geoprior.sim.worlds.tabletop import TABLE_TOP

SEEDS = range(60)
BASE, YAW = np.array([-0.03, 0.07, CUBE_HALF_SIZE]), 0.6
TOP = np.array([0.0, 0.0, 2.0 * CUBE_HALF_SIZE])
EDGE = CUBE_HALF_SIZE * np.array([np.cos(YAW), np.sin(YAW), 0.0])
"""From the base's middle to that of one of its edges."""
RAISED = np.array([0.0, 0.0, 0.01])


@pytest.fixture(scope="module")
def env(ur5e, cameras):
    return environment(Setup(ur5e, Choice(name="stack"), cameras), 10)


@pytest.fixture
def world(env):
    """The base askew, and the hand far above it."""
    env.reset(0)
    env.world.put_base(BASE[:2], YAW)
    return env.world


def _put(world, name: str, centre: np.ndarray, turn: Rotation | None = None) -> None:
    """Put a cube anywhere, at rest."""
    x, y, z, w = (turn or Rotation.identity()).as_quat()
    data = world.sim.data
    joint = getattr(world, name).joints[0]
    data.set_joint_qpos(joint, np.array([*(TABLE_TOP + centre), w, x, y, z]))
    data.set_joint_qvel(joint, np.zeros(6))
    mujoco.mj_forward(world.sim.model._model, data._data)


def test_both_cubes_are_in_the_third_view_and_clear_of_the_hand(env):
    view = third_view(env)
    for seed in SEEDS:
        env.reset(seed)
        cube, base = corners_of(env, "cube"), corners_of(env, "base")
        assert in_view(view, np.vstack([cube, base, env.pose()[None, :3]]), margin=0.01), seed
        assert 0.04 < max(cube[:, 2].max(), base[:, 2].max()) < env.pose()[2] - 0.15
        assert env.world.failure() == ""
        _put(env.world, "cube", env.world.base_position() + TOP)
        assert in_view(view, corners_of(env, "cube"), margin=0.01), seed


def test_cubes_cover_their_range_apart_from_each_other(env):
    config = env.task.config
    places, yaws = [], []
    for seed in SEEDS:
        env.reset(seed)
        both = [env.world.transform_object_to_workspace(each) for each in (env.world.cube, env.world.base)]
        places.append([each[:3, 3] for each in both])
        yaws.append([np.arctan2(each[1, 0], each[0, 0]) for each in both])
    places = np.array(places)
    np.testing.assert_allclose(places[..., 2], CUBE_HALF_SIZE, atol=1e-9)
    ways = places[:, 1, :2] - places[:, 0, :2]
    assert np.linalg.norm(ways, axis=1).min() >= config.gap
    assert np.ptp(ways, axis=0).min() > 0.25
    assert np.ptp(yaws, axis=0).min() > 5.5
    for axis, reach in ((0, config.range_x), (1, config.range_y)):
        assert (np.ptp(places[..., axis], axis=0) > 1.8 * reach).all()
        assert (np.ptp(places[..., axis], axis=0) <= 2.0 * reach).all()


def test_range_without_room_for_the_gap_is_refused():
    config = plugins().spec("task", "stack").config
    with pytest.raises(ValidationError, match="leave no room for a gap"):
        config(range_x=0.05, range_y=0.05)


def test_cubes_are_told_apart_by_their_colours(env):
    model = env.world.sim.model._model
    colours = [
        next(
            model.geom_rgba[geom] for geom in range(model.ngeom) if model.geom(geom).name == f"{name}_g0_vis"
        )
        for name in ("cube", "base")
    ]
    assert np.abs(colours[0] - colours[1]).max() > 0.5


@pytest.mark.parametrize(
    ("share", "turn"),
    [
        (0.0, Rotation.identity()),
        (0.8, Rotation.from_euler("z", YAW)),
        (-0.5, Rotation.from_euler("z", YAW + np.pi / 4.0)),
        (0.0, Rotation.from_euler("xz", [np.pi / 2.0, 0.3])),
    ],
    ids=["in the middle", "near an edge", "askew", "on another face"],
)
def test_cube_lying_on_the_base_counts_and_keeps_lying(env, world, share, turn):
    placed = BASE + TOP + share * EDGE
    _put(world, "cube", placed, turn)
    assert world.succeeded()
    assert world.failure() == ""
    hold(env, 10)
    assert world.succeeded()
    assert np.linalg.norm(world.cube_position() - placed) < 0.001


@pytest.mark.parametrize(
    ("offset", "turn"),
    [
        (-TOP + [0.10, 0.0, 0.0], Rotation.identity()),
        (np.array([0.0, 0.0, 0.006]), Rotation.identity()),
        (1.05 * EDGE, Rotation.from_euler("z", YAW)),
        (np.array([0.0, 0.0, 0.002]), Rotation.from_euler("x", np.radians(12.0))),
    ],
    ids=["beside", "above", "over the edge", "leaning"],
)
def test_cube_elsewhere_does_not_count(world, offset, turn):
    _put(world, "cube", BASE + TOP + offset, turn)
    assert not world.succeeded()
    assert world.failure() == ""


def test_base_on_the_cube_does_not_count(world):
    _put(world, "cube", BASE)
    _put(world, "base", BASE + TOP)
    assert not world.succeeded()


def test_base_must_lie_on_the_table(world):
    _put(world, "base", BASE + RAISED)
    _put(world, "cube", BASE + TOP + RAISED)
    assert np.linalg.norm(world.cube_over_base()) < 1e-9
    assert not world.succeeded()


@pytest.mark.parametrize("name", ["cube", "base"])
def test_nothing_may_move(world, name):
    _put(world, "cube", BASE + TOP)
    assert world.succeeded()
    world.sim.data._data.joint(getattr(world, name).joints[0]).qvel[0] = 0.05
    assert not world.succeeded()


@pytest.mark.parametrize("name", ["cube", "base"])
def test_cube_off_the_table_is_dropped(world, name):
    _put(world, name, np.array([0.0, 0.9, -0.3]))
    assert world.failure() == "dropped"


def test_cube_counts_only_once_it_is_let_go(env):
    env.reset(2)
    held = []
    for command in env.expert(seed=0):
        env.step(command)
        if env.world.succeeded():
            break
        if env.world.cube_on_base() and env.world.object_in_hand(env.world.cube):
            held.append(all(env.world.object_at_rest(each) for each in (env.world.cube, env.world.base)))
    assert any(held)
    assert env.world.succeeded()
    assert not env.world.object_in_hand(env.world.cube)


def test_demonstration_succeeds_and_obeys_the_contract(env):
    assert demonstrate(env, 0, 1) < 120


def test_demonstrations_vary_with_the_root_seed_alone(env):
    """Heights and speeds of the approach, from the same initial state."""
    first = []
    for seed in (0, 1, 0):
        env.reset(0)
        first.append(np.array(list(islice(env.expert(seed=seed), 12))))
    assert np.abs(first[1][:, :3] - first[0][:, :3]).max() > 0.002
    np.testing.assert_array_equal(first[2], first[0])
