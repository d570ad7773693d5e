"""A task: initial states by their seed, a goal not met at the start, an expert that meets it in time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.authoring.conformance.check import Check, digest, require, require_array
from geoprior.authoring.conformance.common import require_own_name
from geoprior.authoring.conformance.stage import demonstrate, frames, world_with
from geoprior.episode import POSE_SIZE
from geoprior.hooks.types import TaskSpec

if TYPE_CHECKING:
    from geoprior.sim.environment import Environment

SEEDS = range(3)
ENOUGH = 2
"""Demonstrations from `SEEDS` that must succeed."""


def says_how_long_it_takes(spec: TaskSpec) -> None:
    """Its name is the spec's; a trial has some seconds, and success is held for fewer."""
    task, where = spec.factory(spec.config()), f"task {spec.name!r}"
    require_own_name(spec, task.name)
    require(task.seconds > 0.0, f"{where}: a trial takes {task.seconds} s")
    require(0.0 <= task.sustain < task.seconds, f"{where}: success must hold for {task.sustain} s")


def a_seed_decides_the_initial_state(spec: TaskSpec) -> None:
    """The same seed gives the same state and the same frames, after other episodes too; seeds differ."""
    env = world_with(spec)
    first = frames(env, SEEDS[0])
    seen: dict[int, str] = {}
    for seed in (*SEEDS, *SEEDS):
        env.reset(seed)
        state = _state(env)
        require(
            seen.setdefault(seed, state) == state,
            f"task {spec.name!r}, seed {seed}: another initial state the second time",
            "draw from the argument of `place_objects` alone, and put back whatever moved",
        )
    require(len(set(seen.values())) > 1, f"task {spec.name!r}: every seed gives the same initial state")
    for camera, again in frames(env, SEEDS[0]).items():
        require(
            np.array_equal(first[camera], again),
            f"task {spec.name!r}, camera {camera!r}: the initial state looks different the second time",
        )


def a_hand_that_waits_does_not_win(spec: TaskSpec) -> None:
    """For a second nothing succeeds by itself."""
    env = world_with(spec)
    for seed in SEEDS:
        env.reset(seed)
        command = env.pose()
        for _ in range(env.control_rate):
            env.step(command)
            require(
                not env.world.succeeded(),
                f"task {spec.name!r}, seed {seed}: succeeds while the hand stays where it began",
                "judge by what the hand must have done",
            )


def commands_are_pose_vectors(spec: TaskSpec) -> None:
    """Commands of the expert are finite, with unit quaternions; the same rng gives the same ones."""
    env = world_with(spec)
    size = len(env.pose())
    takes: list[list[np.ndarray[Any, np.dtype[np.float32]]]] = [[], []]
    for kept in takes:
        env.reset(SEEDS[0])
        for command in env.expert(0):
            require_array(command, f"task {spec.name!r}: a command", (size,), np.float32)
            norms = np.linalg.norm(command.reshape(-1, POSE_SIZE)[:, 3:7], axis=1)
            require(
                np.abs(norms - 1.0).max() < 1e-3, f"task {spec.name!r}: a quaternion is not of unit length"
            )
            kept.append(command)
            env.step(command)
    require(
        np.array_equal(takes[0], takes[1]),
        f"task {spec.name!r}: the expert acts differently the second time",
        "draw from the rng argument of `expert` alone",
    )


def its_expert_succeeds_in_time(spec: TaskSpec) -> None:
    """Most demonstrations succeed, within the seconds that a trial has."""
    env, outcomes = world_with(spec), []
    limit = round(env.task.seconds * env.control_rate)
    for seed in SEEDS:
        env.reset(seed)
        verdict = demonstrate(env, limit)
        outcomes.append({"": "success", None: "not done"}.get(verdict, str(verdict)))
    require(
        outcomes.count("success") >= ENOUGH,
        f"task {spec.name!r}: fewer than {ENOUGH} demonstrations succeed: {', '.join(outcomes)}",
        "`geoprior demos` needs an expert that succeeds more often than not",
    )


def _state(env: Environment) -> str:
    data = env.world.sim.data
    return digest([data.qpos, data.qvel, data.mocap_pos, data.mocap_quat])


CHECKS = (
    Check("it says how long it takes", says_how_long_it_takes),
    Check("a seed decides the initial state", a_seed_decides_the_initial_state, slow=True),
    Check("a hand that waits does not win", a_hand_that_waits_does_not_win, slow=True),
    Check("its expert's commands are pose vectors", commands_are_pose_vectors, slow=True),
    Check("its expert succeeds in time", its_expert_succeeds_in_time, slow=True),
)
