from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
import torch
from scripted_predictors import Expert, HoldStill, NotFinite, SaysNothing, run_trial

from geoprior.policies.act._network import ActNetwork
from geoprior.policies.act.plugin import ActConfig
from geoprior.policies.normalise import Normaliser, measure
from geoprior.policies.predictor import LoadedPredictor
from geoprior.sim.config import EvaluateConfig
from geoprior.sim.environment import UnstablePhysicsError
from geoprior.sim.trial import Outcome, Trial, run_trials
from geoprior.sim.workers import Setup, environments

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


@pytest.mark.parametrize(("policy", "steps"), [(NotFinite, 2), (SaysNothing, 0)])
def test_action_that_is_not_finite_fails_the_trial(env, policy, steps):
    config = EvaluateConfig(time_limit=0.5, ensembling=0.01)
    outcome = run_trial(env, policy(), config, 3)
    assert outcome == Outcome(success=False, reason="NaN action", steps=steps)


def test_broken_physics_fails_the_trial(env, monkeypatch):
    def broken(_command):
        raise UnstablePhysicsError

    monkeypatch.setattr(env, "step", broken)
    assert run_trial(env, HoldStill(), SHORT, 3) == Outcome(success=False, reason="unstable physics", steps=1)


@pytest.mark.parametrize("place", [(3.0, 0.0, 0.2), (-0.56, 0.0, 0.1), (0.0, 0.0, -0.5)])
def test_a_pose_out_of_reach_runs_out_of_time_or_breaks_nothing_else(env, place):
    """Far away, inside the robot's own base, under the table: the arm goes as far as it can."""

    class Insists(HoldStill):
        def predict(self, pose: np.ndarray, images: Mapping[str, np.ndarray]) -> np.ndarray:
            chunk = super().predict(pose, images)
            chunk[..., :3] = place
            return chunk

    outcome = run_trial(env, Insists(), EvaluateConfig(time_limit=2.0), 3)
    assert not outcome.success
    assert outcome.reason in {"time-out", "dropped", "unstable physics"}
    assert outcome.steps > 5
    env.reset(3)
    assert np.isfinite(env.pose()).all()


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


class Wanderer(HoldStill):
    """Goes where a random network sends it, by what it sees; counts its looks."""

    def __init__(self) -> None:
        act = ActConfig(chunk=4, dim=32, heads=2, ffn=64, encoder_layers=1, vae_layers=1, trunk_width=8)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(3)
            network = ActNetwork(act, self.features)
        spread = np.array([[0.0, 0, 0.15, 0.6, 0.6, 0, 0, 0], [0.1, 0.1, 0.25, 0.8, 0.8, 0.1, 0.1, 1]])
        same = measure([spread.astype(np.float32)])
        self.network = LoadedPredictor(
            network, self.features, self.fps, Normaliser({"pose": same, "action": same})
        )
        self.looks: list[int] = []

    def predict(self, pose: np.ndarray, images: Mapping[str, np.ndarray]) -> np.ndarray:
        self.looks.append(len(pose))
        return self.network.predict(pose, images)


def _end(env) -> np.ndarray:
    return env.world.sim.data.qpos.copy()


@pytest.mark.parametrize("config", [{}, {"ensembling": None, "execute": 3}])
def test_an_episode_is_the_same_to_the_bit_alone_and_in_a_batch(ur5e, pick, cameras, config):
    pool = environments(Setup(ur5e, pick, cameras), 10, 3)
    options, policy = EvaluateConfig(time_limit=1.2, **config), Wanderer()
    together = {state % 4: Trial(env, options, state) for state, env in zip((8, 10, 11), pool, strict=True)}
    run_trials(together, policy, rows=4)
    ends = [_end(env) for env in pool]
    assert set(policy.looks) == {4}
    assert not np.allclose(ends[0], ends[1])
    for state, end in ((11, ends[2]), (8, ends[0])):
        run_trials({state % 4: Trial(pool[1], options, state)}, policy, rows=4)
        assert np.array_equal(_end(pool[1]), end)


def test_a_trial_that_fails_leaves_its_mates_alone(ur5e, pick, cameras, monkeypatch):
    pool = environments(Setup(ur5e, pick, cameras), 10, 2)

    def broken(_command):
        raise UnstablePhysicsError

    monkeypatch.setattr(pool[0], "step", broken)
    trials = {row: Trial(env, SHORT, row) for row, env in enumerate(pool)}
    run_trials(trials, HoldStill(), rows=2)
    assert [trial.outcome.reason for trial in trials.values()] == ["unstable physics", "time-out"]
