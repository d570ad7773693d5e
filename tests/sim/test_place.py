from __future__ import annotations

import mujoco
import numpy as np
import pytest

from geoprior.geometry.se3 import apply
from geoprior.sim.experts.grasp import CLOSING_TENTHS
from geoprior.sim.tasks.place.world import INNER_HALF_SIZE, WALL_HEIGHT

GOAL, YAW = np.array([-0.02, 0.06]), 0.6
FREE = INNER_HALF_SIZE - 0.021
"""How far the cube's centre can be from the enclosure's, along its sides."""


@pytest.fixture
def world(place_env):
    """An enclosure askew, and the hand far above it."""
    place_env.reset(0)
    place_env.world.put_goal(GOAL, YAW)
    return place_env.world


def _lay(world, offset: tuple[float, float, float], turn: float = 0.0, speed: float = 0.0) -> None:
    """Put the cube at an offset in the goal's frame, its height counted from lying on the table."""
    model, data = world.sim.model._model, world.sim.data._data
    mujoco.mj_forward(model, data)
    centre = apply(world.transform_goal_to_workspace(), np.array([offset]))[0]
    world.put_cube(centre[:2], YAW + turn)
    joint = data.joint(world.cube.joints[0])
    joint.qpos[2] += offset[2]
    joint.qvel[:] = [speed, 0.0, 0.0, 0.0, 0.0, 0.0]
    mujoco.mj_forward(model, data)


@pytest.mark.parametrize(
    ("offset", "turn"),
    [
        ((0.0, 0.0, 0.0), 0.0),
        ((0.0, 0.0, 0.0), np.pi / 4.0),
        ((FREE - 0.001, FREE - 0.001, 0.0), 0.0),
        ((-FREE + 0.001, 0.0, 0.0), 0.0),
    ],
)
def test_cube_at_rest_within_the_walls_counts(world, offset, turn):
    _lay(world, offset, turn)
    assert world.succeeded()
    assert world.failure() == ""


@pytest.mark.parametrize(
    "offset",
    [
        (FREE + 0.003, 0.0, 0.0),
        (0.0, -FREE - 0.003, 0.0),
        (0.12, 0.0, 0.0),
        (0.0, 0.0, 0.005),
        (INNER_HALF_SIZE, 0.0, WALL_HEIGHT),
    ],
    ids=["in a wall", "in another wall", "outside", "above", "on a wall"],
)
def test_cube_elsewhere_does_not_count(world, offset):
    _lay(world, offset)
    assert not world.succeeded()
    assert world.failure() == ""


def test_moving_cube_does_not_count(world):
    _lay(world, (0.0, 0.0, 0.0), speed=0.05)
    assert not world.succeeded()


def test_cube_off_the_table_is_dropped(world):
    _lay(world, (0.0, 0.9, -0.3))
    assert world.failure() == "dropped"


def test_cube_between_the_fingers_does_not_count(place_env):
    """A cube that has just been grasped, with an enclosure set up around it."""
    place_env.reset(3)
    world, data = place_env.world, place_env.world.sim.data._data
    closing = 0
    for command in place_env.expert(seed=0):
        place_env.step(command)
        closing += command[7] == 1.0
        if closing == CLOSING_TENTHS:
            break
    world.put_goal(world.cube_position()[:2], world.cube_yaw())
    mujoco.mj_kinematics(world.sim.model._model, data)
    assert world.cube_inside()
    assert world.object_at_rest(world.cube)
    assert not world.succeeded()


def test_walls_keep_the_cube_in_and_stay_where_they_are(place_env):
    """The cube is thrown along the table at a wall from within."""
    place_env.reset(0)
    world = place_env.world
    world.put_goal(GOAL, YAW)
    _lay(world, (0.0, 0.0, 0.0), speed=0.6)
    command = place_env.pose()
    for _ in range(15):
        place_env.step(command)
    assert world.succeeded()
    assert np.linalg.norm(world.cube_in_goal_frame()[:2]) > 0.01
    np.testing.assert_allclose(world.transform_goal_to_workspace()[:2, 3], GOAL, atol=1e-12)
