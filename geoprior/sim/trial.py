"""One policy, one initial state: from the reset to a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.errors import NumericalError
from geoprior.sim.ensembling import OpenLoop, TemporalEnsemble
from geoprior.sim.environment import UnstablePhysicsError
from geoprior.sim.judge import BAD_ACTION, TIME_OUT, UNSTABLE, Judge

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from geoprior.policies.policy import Predictor
    from geoprior.sim.config import EvaluateConfig
    from geoprior.sim.environment import Environment


@dataclass(frozen=True)
class Outcome:
    """How a trial went.

    Attributes:
        success: Whether the task's goal was reached and held.
        reason: Why not; empty on success.
        steps: Commands carried out.
    """

    success: bool
    reason: str
    steps: int


def run_trial(
    env: Environment,
    predictor: Predictor,
    config: EvaluateConfig,
    state_seed: int,
    on_step: Callable[[], None] | None = None,
) -> Outcome:
    """Roll a policy out.

    Frames are drawn only when the policy looks: at every step with temporal ensembling, else once a chunk.

    Args:
        env: At the predictor's rate.
        predictor: The policy.
        config: Ensembling and time limit.
        state_seed: The initial state.
        on_step: Called after the reset and after every step, for films.
    """
    env.reset(state_seed)
    judge, controls = Judge(env), _strategy(config)
    limit = config.time_limit if config.time_limit is not None else env.task.seconds
    watch = on_step if on_step is not None else _look_away
    watch()
    for step in range(round(limit * env.control_rate)):
        try:
            if controls.wants_chunk(step):
                controls.add(step, _predict(env, predictor))
            command = controls.command(step)
        except NumericalError:
            return Outcome(success=False, reason=BAD_ACTION, steps=step)
        if not _usable(command):
            return Outcome(success=False, reason=BAD_ACTION, steps=step)
        try:
            env.step(command)
        except UnstablePhysicsError:
            return Outcome(success=False, reason=UNSTABLE, steps=step + 1)
        watch()
        verdict = judge.look()
        if verdict is not None:
            return Outcome(success=not verdict, reason=verdict, steps=step + 1)
    return Outcome(success=False, reason=TIME_OUT, steps=round(limit * env.control_rate))


def _strategy(config: EvaluateConfig) -> TemporalEnsemble | OpenLoop:
    if config.ensembling is None:
        return OpenLoop(config.execute)
    return TemporalEnsemble(config.ensembling)


def _predict(env: Environment, predictor: Predictor) -> NDArray[np.float32]:
    observation = env.observe()
    images = {name: observation.images[name][None] for name in predictor.features.cameras}
    return np.asarray(predictor.predict(observation.pose[None], images)[0])


def _usable(command: NDArray[np.float32]) -> bool:
    """Finite, with a quaternion that has a direction."""
    return bool(np.isfinite(command).all() and np.linalg.norm(command[3:7]) > 1e-3)


def _look_away() -> None:
    """Nobody films."""
