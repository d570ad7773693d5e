from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scripted_predictors import HoldStill, run_trial

from geoprior.sim.config import EvaluateConfig

GOAL = np.array([0.03, -0.08])


@pytest.fixture
def world(push_env):
    push_env.reset(0)
    push_env.world.put_goal(GOAL, 0.0)
    return push_env.world


def _lay(
    world, offset: tuple[float, float], lift: float = 0.0, tilt: float = 0.0, speed: float = 0.0
) -> None:
    """Put the cube beside the area's middle, its lowest corner ``lift`` above the table, tilted about x."""
    model, data = world.sim.model._model, world.sim.data._data
    world.put_cube(GOAL + np.array(offset), 0.0)
    joint = data.joint(world.cube.joints[0])
    x, y, z, w = Rotation.from_euler("x", tilt).as_quat()
    joint.qpos[2] = 0.8 + lift + 0.021 * (np.cos(tilt) + np.sin(abs(tilt)))
    joint.qpos[3:] = [w, x, y, z]
    joint.qvel[:] = [speed, 0.0, 0.0, 0.0, 0.0, 0.0]
    mujoco.mj_forward(model, data)


@pytest.mark.parametrize("share", [0.0, 0.95])
def test_cube_at_rest_with_its_centre_over_the_area_counts(world, share):
    for angle in np.linspace(0.0, 2.0 * np.pi, 7):
        radius = share * world.config.radius
        _lay(world, (radius * np.cos(angle), radius * np.sin(angle)))
        assert world.succeeded()
        assert world.failure() == ""


def test_cube_beside_the_area_does_not_count(world):
    for angle in np.linspace(0.0, 2.0 * np.pi, 7):
        radius = 1.05 * world.config.radius
        _lay(world, (radius * np.cos(angle), radius * np.sin(angle)))
        assert not world.succeeded()


def test_moving_cube_does_not_count(world):
    _lay(world, (0.0, 0.0), speed=0.05)
    assert not world.succeeded()


@pytest.mark.parametrize("tilt", [0.0, 0.3, -0.7])
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.1, 0.1)])
def test_lifting_is_a_failure_and_tilting_is_not(world, tilt, place):
    limit = world.config.lift
    _lay(world, place, lift=0.0, tilt=tilt)
    assert world.failure() == ""
    _lay(world, place, lift=limit - 0.001, tilt=tilt)
    assert world.failure() == ""
    _lay(world, place, lift=limit + 0.001, tilt=tilt)
    assert world.failure() == "lifted"


def test_cube_off_the_table_is_dropped(world):
    _lay(world, (0.0, 0.9), lift=-0.3)
    assert world.failure() == "dropped"


def test_lifted_cube_ends_the_trial_even_over_the_area(push_env):
    def lift() -> None:
        push_env.world.put_goal(GOAL, 0.0)
        _lay(push_env.world, (0.0, 0.0), lift=0.03)

    outcome = run_trial(push_env, HoldStill(), EvaluateConfig(time_limit=0.5), 3, on_step=lift)
    assert (outcome.success, outcome.reason, outcome.steps) == (False, "lifted", 1)


def test_area_is_there_to_be_seen_and_nothing_else(world):
    model = world.sim.model._model
    geoms = np.flatnonzero(model.geom_bodyid == model.body(world.goal.root_body).id)
    assert len(geoms) == 1
    assert not model.geom_contype[geoms].any()
    assert not model.geom_conaffinity[geoms].any()
    assert model.geom_group[geoms[0]] == 1


def test_demonstration_keeps_the_cube_down_and_the_fingers_closed(push_env):
    push_env.reset(4)
    heights, commands = [], []
    for command in push_env.expert(seed=0):
        push_env.step(command)
        commands.append(command)
        heights.append(push_env.world.cube_clearance())
    assert set(np.array(commands)[:, 7]) == {1.0}
    assert max(heights) < 0.5 * push_env.world.config.lift
    assert push_env.world.succeeded()
