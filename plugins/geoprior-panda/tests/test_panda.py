from __future__ import annotations

import numpy as np
import pytest
from geoprior_panda import PANDA

from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.se3 import apply, invert, transforms_of_poses
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.sim.environment import Environment
from geoprior.sim.judge import Judge
from geoprior.sim.setting import Setting


def _environment(task: str) -> Environment:
    found = plugins()
    setting = Setting(CamerasConfig(), 10, found.build("look", Choice(name="plain")))
    return Environment(PANDA, found.build("task", Choice(name=task)), setting)


@pytest.fixture(scope="module")
def env():
    return _environment("pick")


@pytest.mark.parametrize(
    "numbers",
    [
        [0.05, -0.08, 0.2, 0.8314696, 0.5555702, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.15, 0.6532815, 0.6532815, 0.2705981, -0.2705981, 0.0],
    ],
)
def test_the_hand_goes_where_a_pose_vector_says(env, numbers):
    command = np.array(numbers, dtype=np.float32)
    env.reset(0)
    for _ in range(25):
        env.step(command)
    reached, wanted = transforms_of_poses(env.pose()), transforms_of_poses(command)
    assert np.abs(reached[:3, 3] - wanted[:3, 3]).max() < 0.012
    assert np.abs(reached[:3, :3] - wanted[:3, :3]).max() < 0.05


def test_the_fingers_open_along_right(env):
    env.reset(0)
    data, model = env.world.sim.data, env.world.sim.model
    pads = [f"gripper0_right_finger{number}_pad_collision" for number in (1, 2)]
    points = np.array([data.geom_xpos[model.geom_name2id(pad)] for pad in pads]) - [0.0, 0.0, 0.8]
    first, second = apply(invert(env.world.transform_hand_to_workspace()), points)
    assert abs(first[0] - second[0]) > 0.04
    assert np.abs(first[1:] - second[1:]).max() < 0.002


@pytest.mark.parametrize("task", ["pick", "place", "push", "pile", "door"])
def test_a_scripted_demonstration_succeeds(task):
    env = _environment(task)
    env.reset(1)
    judge, verdict = Judge(env), None
    for command in env.expert(0):
        env.step(command)
        verdict = judge.look()
        assert not verdict
    assert verdict == ""
