from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.sim.workers import environment

STATE = ("qpos", "qvel", "qacc_warmstart", "ctrl", "time")


@pytest.mark.parametrize("arm", ["ur5e", "xarm7", pytest.param("kinova3", marks=pytest.mark.slow)])
def test_states_equal_stock_robosuite_to_the_bit(arm, pick, cameras):
    """Our stepping on light meshes against ``env.step`` of an untouched world, through a whole grasp."""
    ours = environment(Choice(name=arm), pick, cameras, 10)
    stock = ours.task.make(ours.robot, cameras, 10)
    assert stock.sim.model.mesh_facenum.sum() > 3 * ours.world.sim.model.mesh_facenum.sum()
    ours.reset(3)
    stock.state_seed = 3
    stock.reset()
    for step, command in enumerate(islice(ours.expert(seed=0), 50)):
        stock.step(ours.action_of(command))
        ours.step(command)
        if step % 5 == 0:
            ours.render()
        for name in STATE:
            mine, theirs = getattr(ours.world.sim.data, name), getattr(stock.sim.data, name)
            assert np.array_equal(mine, theirs), f"{name} differs at step {step}"
    assert step >= 39
    assert ours.world.succeeded()
    assert stock.succeeded()


def test_every_arm_is_registered():
    assert {"ur5e", "xarm7", "kinova3"} <= set(plugins().names("robot"))
