from __future__ import annotations

from itertools import islice

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from task_checks import corners_of, demonstrate, hold, third_view

from geoprior.geometry.projection import in_view
from geoprior.options import Choice
from geoprior.sim.workers import Setup, environment
from geoprior.sim.worlds.vessels import CAN_HEIGHT, CAN_RADIUS

SEEDS = range(60)
PLACE = np.array([-0.02, 0.08, 0.0])
RIMS = np.array(
    [
        [CAN_RADIUS * np.cos(angle), CAN_RADIUS * np.sin(angle), height]
        for angle in np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
        for height in (0.0, CAN_HEIGHT)
    ]
)
TILTS = [0, 12, -40, 75, 90, 140, 180]


@pytest.fixture(scope="module")
def env(ur5e, cameras):
    return environment(Setup(ur5e, Choice(name="can"), cameras), 10)


@pytest.fixture
def world(env):
    """A can, and the hand far above it."""
    env.reset(0)
    return env.world


def _put(world, position: np.ndarray, tilt: float = 0.0) -> None:
    """Its foot there, and the can leaning by so many degrees."""
    world.put_can(position, np.radians(tilt))
    mujoco.mj_forward(world.sim.model._model, world.sim.data._data)


def _put_lowest_point(world, height: float, tilt: float) -> None:
    lowest = Rotation.from_euler("x", tilt, degrees=True).apply(RIMS)[:, 2].min()
    _put(world, PLACE + np.array([0.0, 0.0, height - lowest]), tilt)


def test_can_is_in_the_third_view_and_clear_of_the_hand(env):
    view = third_view(env)
    for seed in SEEDS:
        env.reset(seed)
        can = corners_of(env, "can")
        assert in_view(view, np.vstack([can, env.pose()[None, :3]]), margin=0.01), seed
        assert 0.07 < can[:, 2].max() < env.pose()[2] - 0.1
        assert env.world.failure() == ""


def test_can_covers_its_range(env):
    config, places = env.task.config, []
    for seed in SEEDS:
        env.reset(seed)
        places.append(env.world.can_position())
    places = np.array(places)
    np.testing.assert_allclose(places[:, 2], 0.0, atol=1e-9)
    for axis, reach in ((0, config.range_x), (1, config.range_y)):
        assert np.ptp(places[:, axis]) > 1.8 * reach
        assert np.abs(places[:, axis]).max() <= reach


@pytest.mark.parametrize("tilt", TILTS)
def test_all_of_the_can_must_be_lifted_whichever_way_it_leans(world, tilt):
    lift = world.config.lift
    _put_lowest_point(world, lift + 0.0005, tilt)
    assert world.succeeded()
    _put_lowest_point(world, lift - 0.0005, tilt)
    assert not world.succeeded()


@pytest.mark.parametrize("tilt", TILTS)
def test_can_that_only_leans_or_lies_on_the_table_does_not_count(world, tilt):
    """Not even one on its head, whose foot is higher than the lift."""
    _put_lowest_point(world, 0.0, tilt)
    assert not world.succeeded()


@pytest.mark.parametrize("tilt", [90, -90, 180])
def test_can_that_fell_over_is_dropped(world, tilt):
    _put_lowest_point(world, 0.0, tilt)
    assert world.failure() == "dropped"


def test_can_off_the_table_is_dropped(world):
    _put(world, np.array([0.0, 0.9, -0.3]))
    assert world.failure() == "dropped"


def test_leaning_can_and_one_that_slips_in_the_hand_may_still_be_lifted(env, world):
    _put_lowest_point(world, 0.0, 30.0)
    assert world.failure() == ""
    env.reset(0)
    for command in env.expert(seed=0):
        env.step(command)
    _put(world, world.can_position() + np.array([0.0, 0.03, 0.02]), 75.0)
    assert world.object_in_hand(world.can)
    assert world.failure() == ""


def test_only_a_closed_hand_lifts_the_can(env):
    """The demonstration's commands, with the fingers left open."""
    env.reset(1)
    for command in env.expert(seed=0):
        command[7] = 0.0
        env.step(command)
        assert env.world.failure() == ""
    assert env.world.can_clearance() < 0.001
    assert not env.world.succeeded()


def test_can_stands_still(env, world):
    _put(world, PLACE)
    hold(env, 10)
    assert np.linalg.norm(world.can_position() - PLACE) < 0.001
    assert np.abs(world.sim.data.get_joint_qvel(world.can.joints[0])).max() < 1e-3


def test_demonstration_succeeds_and_obeys_the_contract(env):
    assert demonstrate(env, 0, 1) < 80


def test_demonstrations_vary_with_the_root_seed_alone(env):
    """Heights and speeds of the approach, from the same initial state."""
    first = []
    for seed in (0, 1, 0):
        env.reset(0)
        first.append(np.array(list(islice(env.expert(seed=seed), 12))))
    assert np.abs(first[1][:, :3] - first[0][:, :3]).max() > 0.002
    np.testing.assert_array_equal(first[2], first[0])
