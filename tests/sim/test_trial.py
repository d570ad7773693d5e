from __future__ import annotations

import numpy as np
import pytest
from scripted_predictors import Expert, HoldStill, NotFinite, RefusesToSay

from geoprior.sim.config import EvaluateConfig
from geoprior.sim.environment import UnstablePhysicsError
from geoprior.sim.trial import Outcome, run_trial

SHORT = EvaluateConfig(time_limit=0.5)


def test_expert_wins_and_success_must_hold(env):
    looks = []
    outcome = run_trial(
        env, Expert(env), EvaluateConfig(), 3, on_step=lambda: looks.append(env.world.succeeded())
    )
    assert outcome.success
    assert outcome.reason == ""
    assert 20 < outcome.steps < 60
    assert len(looks) == outcome.steps + 1
    # Held for 0.2 s, that is 2 steps, and not a step longer than that.
    assert looks[-3:] == [False, True, True]


def test_idle_policy_runs_out_of_time(env):
    assert run_trial(env, HoldStill(), SHORT, 3) == Outcome(success=False, reason="time-out", steps=5)


@pytest.mark.parametrize(("policy", "steps"), [(NotFinite, 2), (RefusesToSay, 0)])
def test_action_that_is_not_finite_fails_the_trial(env, policy, steps):
    config = EvaluateConfig(time_limit=0.5, ensembling=0.01)
    outcome = run_trial(env, policy(), config, 3)
    assert outcome == Outcome(success=False, reason="NaN action", steps=steps)


def test_broken_physics_fails_the_trial(env, monkeypatch):
    def broken(_command):
        raise UnstablePhysicsError

    monkeypatch.setattr(env, "step", broken)
    assert run_trial(env, HoldStill(), SHORT, 3) == Outcome(success=False, reason="unstable physics", steps=1)


def test_cube_off_the_table_ends_the_trial(env):
    def push_off() -> None:
        env.world.sim.data.set_joint_qpos("cube_joint0", np.array([0.0, 0.9, 0.5, 1.0, 0.0, 0.0, 0.0]))

    assert run_trial(env, HoldStill(), SHORT, 3, on_step=push_off).reason == "dropped"


@pytest.mark.parametrize(
    ("config", "looks"), [({"ensembling": 0.01}, 5), ({"ensembling": None, "execute": 2}, 3)]
)
def test_frames_are_drawn_only_when_the_policy_looks(env, monkeypatch, config, looks):
    drawn = []
    render = env.render
    monkeypatch.setattr(env, "render", lambda: drawn.append(1) or render())
    run_trial(env, HoldStill(), EvaluateConfig(time_limit=0.5, **config), 3)
    assert len(drawn) == looks
