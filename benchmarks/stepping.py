"""Control steps counted, each side in processes of its own: ours, and robosuite as it comes."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import cycle, islice
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.clock import seconds_of
from geoprior.errors import MachineError
from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.sim.environment import Environment

    Commands = list[NDArray[np.float32]]

SIZE = 128
CONTROL_RATE = 10
ROBOT, STOCK_ROBOT = "ur5e", "UR5e"
STOCK_CAMERAS = ("agentview", "robot0_eye_in_hand")
STATES = (20_000, 20_001, 20_002)
EXPERT_SEED = 0


@dataclass(frozen=True)
class Drive:
    """A way to roll out.

    Attributes:
        controller: Of `geoprior.sim.control`.
        look_every: Both cameras are drawn at every so many steps.
    """

    controller: str
    look_every: int


@dataclass(frozen=True)
class Slice:
    """What was done in a stretch of time; resets are not counted.

    Attributes:
        steps: Control steps.
        seconds: Wall time that they took.
    """

    steps: int
    seconds: float

    @property
    def rate(self) -> float:
        """Control steps a second."""
        return self.steps / self.seconds


@dataclass(frozen=True)
class Costs:
    """Where a control step of ours goes with both cameras drawn, in milliseconds; medians.

    Attributes:
        physics: MuJoCo's own steps.
        controller: What steers them.
        frames: Both pictures.
        rest: Poses, the task's judge and checks.
    """

    physics: float
    controller: float
    frames: float
    rest: float


def step_ours(drive: Drive, seconds: float) -> Slice:
    """Follow the expert's commands on the arm for so many seconds, looking and judging as a rollout does."""
    from geoprior.sim.judge import Judge

    env = _environment(drive.controller)
    steps, spent = 0, 0.0
    for state in cycle(STATES):
        commands = _expert_commands(state)
        env.reset(state)
        judge = Judge(env)
        began = time.perf_counter()
        for step, command in enumerate(commands):
            if step % drive.look_every == 0:
                env.observe()
            env.step(command)
            judge.look()
            steps += 1
            if spent + time.perf_counter() - began > seconds:
                break
        spent += time.perf_counter() - began
        if spent > seconds:
            break
    return Slice(steps, spent)


def step_stock(seconds: float) -> Slice:
    """Step robosuite's own Lift, with its own pictures in its observations.

    Raises:
        MachineError: The pictures stay the same while the arm moves: nothing is drawn.
    """
    env = _stock_environment()
    steps, pictures, began = 0, [], time.perf_counter()
    while steps < 2 or time.perf_counter() - began < seconds:
        observation, *_ = env.step(0.3 * np.sin(0.3 * steps + np.arange(env.action_dim)))
        pictures.append([observation[f"{camera}_image"] for camera in STOCK_CAMERAS])
        steps += 1
    taken = time.perf_counter() - began
    for camera, first, last in zip(STOCK_CAMERAS, pictures[0], pictures[-1], strict=True):
        if np.array_equal(first, last):
            raise MachineError(f"robosuite draws nothing new through its camera {camera!r}")
    return Slice(steps, taken)


def measure_costs(controller: str) -> Costs:
    """Time the parts of a step over whole demonstrations, in this process alone.

    The physics is timed on a copy of the state that each command leaves, without a controller.
    """
    from geoprior.sim.control import PoseControl
    from geoprior.sim.judge import Judge

    env = _environment(controller)
    bare = _BarePhysics(env)
    rows: dict[str, list[float]] = {"physics": [], "advance": [], "frames": [], "step": []}
    for state in STATES:
        commands = _expert_commands(state)
        env.reset(state)
        judge = Judge(env)
        for command in commands:
            rows["frames"].append(seconds_of(env.observe))
            rows["step"].append(seconds_of(env.step, command) + seconds_of(judge.look))
            rows["physics"].append(bare.seconds())
        env.reset(state)
        control = PoseControl(env.world, controller)
        for command in commands:
            rows["advance"].append(seconds_of(control.advance, env.action_of(command)))
    parts = {name: 1e3 * median(times) for name, times in rows.items()}
    return Costs(
        physics=parts["physics"],
        controller=parts["advance"] - parts["physics"],
        frames=parts["frames"],
        rest=parts["step"] - parts["advance"],
    )


class _BarePhysics:
    """MuJoCo's steps of one command, without any controller, on data of its own."""

    def __init__(self, env: Environment) -> None:
        import mujoco

        self._mujoco, self._model, self._data = mujoco, env.world.sim.model._model, env.world.sim.data._data
        self._scratch = mujoco.MjData(self._model)
        self._kind = mujoco.mjtState.mjSTATE_INTEGRATION
        self._state = np.empty(mujoco.mj_stateSize(self._model, self._kind))
        self._substeps = round(env.world.control_timestep / env.world.model_timestep)

    def seconds(self) -> float:
        """Wall time from the environment's state on, which stays as it is."""
        self._mujoco.mj_getState(self._model, self._data, self._state, self._kind)
        self._mujoco.mj_setState(self._model, self._scratch, self._state, self._kind)
        return seconds_of(self._step)

    def _step(self) -> None:
        for _ in range(self._substeps):
            self._mujoco.mj_step1(self._model, self._scratch)
            self._mujoco.mj_step2(self._model, self._scratch)


def _environment(controller: str) -> Environment:
    from geoprior.sim.workers import Setup, environment

    robot = Choice(name=ROBOT, options={"controller": controller})
    setup = Setup(robot, Choice(name="pick"), CamerasConfig(height=SIZE, width=SIZE))
    return environment(setup, CONTROL_RATE)


@lru_cache(maxsize=len(STATES))
def _expert_commands(state: int) -> Commands:
    """The expert of `pick` decides at the start: its commands are the same whatever drives the arm."""
    env = _environment("exact")
    env.reset(state)
    commands: Iterator[NDArray[np.float32]] = env.expert(EXPERT_SEED)
    return list(islice(commands, round(env.task.seconds * CONTROL_RATE)))


@lru_cache(maxsize=1)
def _stock_environment() -> Any:
    """Lift as `robosuite.make` gives it, drawn off screen with Mesa's own number of threads."""
    from geoprior.sim.backend import prepare_robosuite

    threads = os.environ.get("LP_NUM_THREADS")
    prepare_robosuite()
    if threads is None:
        os.environ.pop("LP_NUM_THREADS", None)
    import robosuite

    env = robosuite.make(
        "Lift",
        robots=STOCK_ROBOT,
        has_renderer=False,
        has_offscreen_renderer=True,
        use_camera_obs=True,
        camera_names=list(STOCK_CAMERAS),
        camera_heights=SIZE,
        camera_widths=SIZE,
        control_freq=CONTROL_RATE,
        ignore_done=True,
        seed=0,
    )
    env.reset()
    return env
