from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoprior.episode import validate_poses
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.sim.demos import AttemptTask, record_expert
from geoprior.sim.environment import Environment
from geoprior.sim.experts.path import Waypoint, commands_in, follow, hand_down
from geoprior.sim.judge import Judge
from geoprior.sim.workers import Setup, environment


def _attempt(robot: str, task: str, number: int, cameras: CamerasConfig) -> AttemptTask:
    return AttemptTask(
        number, number, Setup(Choice(name=robot), Choice(name=task), cameras), 10, 0, Path("unused")
    )


def test_path_is_smooth_and_ends_at_its_waypoints():
    start = np.array([0.0, 0.0, 0.25, np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0, 0.0], dtype=np.float32)
    points = [
        Waypoint(np.array([0.1, 0.1, 0.1]), hand_down(0.7), 0.0, 0.2),
        Waypoint(np.array([0.1, 0.1, 0.02]), hand_down(0.7), 1.0, 0.1, wait=4),
    ]
    commands = np.array(list(follow(start, points, 50)))
    speeds = np.linalg.norm(np.diff(commands[:, :3], axis=0), axis=1) * 50.0
    assert speeds.max() < 1.9 * 0.2 * 1.05
    assert np.abs(np.diff(speeds)).max() < 0.06
    np.testing.assert_allclose(commands[-4:, :3], np.tile([0.1, 0.1, 0.02], (4, 1)), atol=1e-6)
    up = Rotation.from_quat(commands[-1, 3:7]).as_matrix()[:, 1]
    np.testing.assert_allclose(up, [np.cos(0.7), np.sin(0.7), 0.0], atol=1e-6)
    assert (np.sum(commands[1:, 3:7] * commands[:-1, 3:7], axis=1) > 0.99).all()
    closed = commands[:, 7]
    assert set(closed) == {0.0, 1.0}
    assert (np.diff(closed) >= 0.0).all()


@pytest.mark.parametrize(
    ("task", "mean_steps"), [("pick", (30, 65)), ("place", (65, 95)), ("push", (45, 80))]
)
def test_demonstrations_succeed_vary_and_obey_the_contract(task, mean_steps, cameras):
    env = environment(Setup(Choice(name="ur5e"), Choice(name=task), cameras), 10)
    lengths, heights = [], []
    for number in range(3):
        episode, reason, steps = record_expert(env, _attempt("ur5e", task, number, cameras))
        assert episode is not None, (number, reason)
        episode.validate()
        validate_poses(episode.header, "action", episode.action)
        assert episode.header.steps == steps == len(episode.pose)
        assert episode.header.seed == number
        assert abs(episode.action[:, :3] - episode.pose[:, :3]).max() < 0.1
        lengths.append(steps)
        heights.append(episode.action[-1, 2])
    assert len(set(lengths)) > 1
    assert np.ptp(heights) > 0.001
    assert mean_steps[0] < np.mean(lengths) < mean_steps[1]


def _outcome(env: Environment) -> str | None:
    """Run the expert from the state just reset, without a picture."""
    judge, verdict = Judge(env), None
    for command in env.expert(seed=0):
        env.step(command)
        verdict = judge.look()
        if verdict:
            return verdict
    return verdict


@pytest.mark.parametrize("rate", [20, 25, 50])
def test_waits_last_as_long_at_any_rate(rate):
    start = np.array([0.0, 0.0, 0.25, np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0, 0.0], dtype=np.float32)
    points = [Waypoint(start[:3].astype(float), Rotation.from_quat(start[3:7]), 1.0, 0.2, wait=13)] * 3
    seconds = [len(list(follow(start, points, each))) / each for each in (10, rate)]
    assert seconds[1] == pytest.approx(seconds[0], abs=3 * 0.1)


@pytest.mark.parametrize("rate", [1, 2, 5])
def test_fingers_get_as_many_commands_at_low_rates(rate):
    assert commands_in(13, rate) == commands_in(13, 10) == 13
    assert commands_in(0, rate) == 0


@pytest.mark.parametrize("task", ["push", "pile"])
def test_an_expert_takes_its_time_at_fifty_commands_a_second(task, cameras):
    """The two that failed when their waits were counted in commands."""
    lengths = []
    for rate in (10, 50):
        env, commands = environment(Setup(Choice(name="ur5e"), Choice(name=task), cameras), rate), 0
        for state in range(600_000, 600_003):
            env.reset(state)
            judge, verdict = Judge(env), None
            for command in env.expert(seed=0):
                env.step(command)
                verdict, commands = judge.look(), commands + 1
            assert verdict == "", (rate, state, verdict)
        lengths.append(commands / rate)
    assert lengths[1] == pytest.approx(lengths[0], rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("task", plugins().names("task"))
@pytest.mark.parametrize("robot", ["ur5e", "xarm7", "kinova3"])
def test_expert_succeeds_on_95_of_100_states(robot, task, cameras):
    env = environment(Setup(Choice(name=robot), Choice(name=task), cameras), 10)
    outcomes = []
    for seed in range(100):
        env.reset(seed)
        outcomes.append(_outcome(env))
    assert sum(outcome == "" for outcome in outcomes) >= 95, outcomes
