from __future__ import annotations

import pytest
from task_checks import assert_steps_like_robosuite

from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.sim.environment import Environment
from geoprior.sim.workers import Setup, environment

ARMS = ("ur5e", "xarm7", "kinova3")
TASKS = ("pick", "place", "push", "pile", "door")
COMBINATIONS = [(arm, task) for arm in ARMS for task in TASKS]
COMBINATIONS += [("ur5e", task) for task in ("can", "stack", "close", "cable")]
QUICK = {("ur5e", "pick"), ("xarm7", "push"), ("kinova3", "door")}


def _exact(arm: str, task: str, cameras: CamerasConfig) -> Environment:
    robot = Choice(name=arm, options={"controller": "exact"})
    return environment(Setup(robot, Choice(name=task), cameras), 10)


@pytest.mark.parametrize(("arm", "task"), sorted(QUICK))
def test_states_equal_stock_robosuite_to_the_bit(arm, task, cameras):
    """Our stepping on light meshes against ``env.step`` of an untouched world, through a grasp."""
    env = _exact(arm, task, cameras)
    assert_steps_like_robosuite(env, 3, 60)


@pytest.mark.slow
@pytest.mark.parametrize(("arm", "task"), COMBINATIONS)
def test_200_states_equal_stock_robosuite_to_the_bit(arm, task, cameras):
    """The whole demonstration, and what is left of 20 s with the hand held where it ends."""
    assert_steps_like_robosuite(_exact(arm, task, cameras), 3, 200)


def test_every_arm_is_registered():
    assert {"ur5e", "xarm7", "kinova3"} <= set(plugins().names("robot"))
