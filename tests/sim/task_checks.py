"""What the tests of several tasks look at: the third camera's view, and robosuite's own loop."""

from __future__ import annotations

from itertools import chain, islice, repeat
from pathlib import Path

import numpy as np

from geoprior.episode import validate_poses
from geoprior.geometry.projection import View
from geoprior.geometry.se3 import invert
from geoprior.options import Choice
from geoprior.sim.demos import AttemptTask, record_expert
from geoprior.sim.environment import Environment, UnstablePhysicsError
from geoprior.sim.judge import Judge
from geoprior.sim.workers import Setup
from geoprior.sim.worlds.tabletop import TABLE_TOP

STATE = ("qpos", "qvel", "qacc_warmstart", "ctrl", "time")
_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


def third_view(env: Environment) -> View:
    """The third camera, by the numbers of the episode's header."""
    header = next(header for header in env.camera_headers() if header.name == "third")
    to_camera = invert(np.array(header.transform_camera_to_mount))
    return View(to_camera, np.array(header.intrinsics), header.height, header.width)


def corners_of(env: Environment, prefix: str) -> np.ndarray:
    """Corners (P, 3) in the workspace of the boxes around all that is drawn of an object."""
    model, data = env.world.sim.model._model, env.world.sim.data._data
    drawn = [
        geom
        for geom in range(model.ngeom)
        if model.geom(geom).name.startswith(prefix) and model.geom_group[geom] == 1
    ]
    boxes = [
        (model.geom_aabb[geom, :3] + _SIGNS * model.geom_aabb[geom, 3:])
        @ data.geom_xmat[geom].reshape(3, 3).T
        + data.geom_xpos[geom]
        for geom in drawn
    ]
    return np.concatenate(boxes) - TABLE_TOP


def demonstrate(env: Environment, number: int, state: int) -> int:
    """A demonstration succeeds and obeys the episode contract; returns its commands."""
    setup = Setup(Choice(name=env.robot.name), Choice(name=env.task.name), env.cameras)
    task = AttemptTask(number, state, setup, env.control_rate, 0, Path("unused"))
    episode, reason, steps = record_expert(env, task)
    assert episode is not None, (number, reason)
    episode.validate()
    validate_poses(episode.header, "action", episode.action)
    assert set(episode.action[:, 7]) == {0.0, 1.0}
    return steps


def hold(env: Environment, steps: int) -> None:
    """Let time pass while the hand stays where it is."""
    command = env.pose()
    for _ in range(steps):
        env.step(command)


def assert_steps_like_robosuite(env: Environment, state_seed: int, steps: int) -> None:
    """The expert's commands, the last one repeated: every state equals that of ``env.step``, to the bit."""
    assert env.controller == "exact"
    stock = env.task.make(env.robot, env.setting)
    assert stock.sim.model.mesh_facenum.sum() > 3 * env.world.sim.model.mesh_facenum.sum()
    env.reset(state_seed)
    stock.state_seed = state_seed
    stock.reset()
    last = env.pose()
    for step, command in enumerate(islice(chain(env.expert(seed=0), repeat(None)), steps)):
        last = command if command is not None else last
        stock.step(env.action_of(last))
        env.step(last)
        if step % 5 == 0:
            env.render()
        for name in STATE:
            mine, theirs = getattr(env.world.sim.data, name), getattr(stock.sim.data, name)
            assert np.array_equal(mine, theirs), f"{name} differs at step {step}"
    assert env.world.succeeded() == stock.succeeded()


def successes_of_a_replay(env: Environment, states: range) -> int:
    """How often the commands of one successful demonstration, carried out blindly, win from other states."""
    env.reset(0)
    commands, judge = [], Judge(env)
    for command in env.expert(seed=0):
        commands.append(command)
        env.step(command)
        verdict = judge.look()
    assert verdict == ""
    return sum(_replay(env, [*commands, *commands[-1:] * 10], state) for state in states)


def _replay(env: Environment, commands: list[np.ndarray], state: int) -> bool:
    env.reset(state)
    judge = Judge(env)
    for command in commands:
        try:
            env.step(command)
        except UnstablePhysicsError:
            return False
        verdict = judge.look()
        if verdict is not None:
            return not verdict
    return False
