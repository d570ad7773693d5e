from __future__ import annotations

from itertools import chain, repeat
from pathlib import Path

import geoprior_bimanual.lift_pot
import numpy as np
import pytest

from geoprior.authoring.testing import Case, cases
from geoprior.errors import ConfigError
from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice
from geoprior.sim.demos import AttemptTask, record_expert
from geoprior.sim.environment import Environment
from geoprior.sim.judge import Judge
from geoprior.sim.workers import Setup, environment

CAMERAS = CamerasConfig(height=64, width=64)


def _environment(robot: str = "ur5e", **options: object) -> Environment:
    task = Choice(name="lift-pot", options=options)
    return environment(Setup(Choice(name=robot), task, CAMERAS), 10)


@pytest.fixture
def env() -> Environment:
    return _environment()


def _verdict(env: Environment, state: int, still: slice | None = None) -> str | None:
    """How a demonstration goes; the numbers of a command at ``still`` stay those of the start."""
    env.reset(state)
    judge, verdict, start, last = Judge(env), None, env.pose(), env.pose()
    for command in chain(env.expert(0), repeat(None, 10)):
        last = last if command is None else command.copy()
        if still is not None:
            last[still] = start[still]
        env.step(last)
        verdict = judge.look()
        if verdict is not None:
            break
    return verdict


@pytest.mark.parametrize("case", cases(geoprior_bimanual.lift_pot))
def test_it_keeps_the_contract(case: Case) -> None:
    case.check()


def test_demonstrations_succeed(env: Environment) -> None:
    assert [_verdict(env, state) for state in range(3)] == ["", "", ""]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "partner", "wanted"),
    [("ur5e", "ur5e", 19), ("xarm7", "xarm7", 19), ("ur5e", "kinova3", 19), ("kinova3", "kinova3", 17)],
)
def test_of_20_demonstrations_nearly_all_succeed(robot: str, partner: str, wanted: int) -> None:
    env = _environment(robot, partner=partner)
    assert sum(_verdict(env, state) == "" for state in range(20)) >= wanted


@pytest.mark.parametrize("still", [slice(0, 8), slice(8, 16)])
def test_one_hand_alone_does_not_lift_it(env: Environment, still: slice) -> None:
    assert _verdict(env, 1, still) is None


def test_a_demonstration_keeps_the_contract(env: Environment) -> None:
    setup = Setup(Choice(name="ur5e"), Choice(name="lift-pot"), CAMERAS)
    episode, reason, steps = record_expert(env, AttemptTask(0, 0, setup, 10, 0, Path("unused")))
    assert episode is not None, reason
    episode.validate()
    assert episode.header.hands == ["left", "right"]
    assert sorted(episode.images) == ["left", "right", "third"]
    assert episode.pose.shape == (steps, 16)
    assert (episode.pose[:, 1] > episode.pose[:, 9]).all(), "left is towards +y"


def test_the_pot_lies_where_the_options_say_and_its_handles_are_the_hands(env: Environment) -> None:
    places = []
    for state in range(10):
        env.reset(state)
        pot = env.world.transform_object_to_workspace(env.world.pot)
        places.append([*pot[:2, 3], env.world.pot_yaw()])
        handles = env.world.handles()
        assert handles["left"][1] > handles["right"][1]
        assert np.linalg.norm(handles["left"] - handles["right"]) == pytest.approx(0.28)
    assert (np.abs(places) <= [0.05, 0.05, np.radians(20.0)]).all()
    assert (np.ptp(places, axis=0) > [0.04, 0.04, np.radians(15.0)]).all()


def test_the_partner_is_an_arm_of_another_kind_driven_in_the_same_way() -> None:
    exact = Choice(name="ur5e", options={"controller": "exact"})
    task = Choice(name="lift-pot", options={"partner": "xarm7"})
    env = environment(Setup(exact, task, CAMERAS), 10)
    robots = [(arm.robot.name, arm.robot.controller) for arm in env.world.arms.values()]
    assert robots == [("ur5e", "exact"), ("xarm7", "exact")]
    assert _verdict(env, 2) == ""


def test_an_unknown_partner_is_named() -> None:
    with pytest.raises(ConfigError, match="unknown robot 'ur6'"):
        _environment(partner="ur6")
