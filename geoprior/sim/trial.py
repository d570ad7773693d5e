"""One policy, some initial states: from the resets to the verdicts.

Trials run side by side and the policy looks for all of them at once. Each has its own row of the network's
batch, the batch always has the same number of rows, and what stands in the other rows does not enter a row's
sums: a trial is the same to the bit alone and in company.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.episode import POSE_SIZE
from geoprior.sim.ensembling import OpenLoop, TemporalEnsemble
from geoprior.sim.environment import UnstablePhysicsError
from geoprior.sim.judge import BAD_ACTION, TIME_OUT, UNSTABLE, Judge

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

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


class Trial:
    """A trial that is under way.

    Frames are drawn only when the policy looks: at every step with temporal ensembling, else once a chunk.

    Args:
        env: At the policy's rate; nobody else uses it meanwhile. It is reset here.
        config: Ensembling and time limit.
        state_seed: The initial state.
        on_step: Called after the reset and after every step, for films.

    Attributes:
        outcome: None until the trial is over.
    """

    def __init__(
        self,
        env: Environment,
        config: EvaluateConfig,
        state_seed: int,
        on_step: Callable[[], None] | None = None,
    ) -> None:
        env.reset(state_seed)
        self.outcome: Outcome | None = None
        self._env, self._judge, self._controls = env, Judge(env), _strategy(config)
        limit = config.time_limit if config.time_limit is not None else env.task.seconds
        self._limit = round(limit * env.control_rate)
        self._watch = on_step if on_step is not None else _look_away
        self._step = 0
        self._watch()

    @property
    def wants_chunk(self) -> bool:
        """Whether the policy has to look before the next step."""
        return self._controls.wants_chunk(self._step)

    def observe(self) -> tuple[NDArray[np.float32], Mapping[str, NDArray[np.uint8]]]:
        """Pose (8 x hands) and frames (H, W, 3) now."""
        observation = self._env.observe()
        return observation.pose, observation.images

    def take(self, chunk: NDArray[np.float32]) -> None:
        """Take the commands (K, 8 x hands) that were predicted from what was just observed."""
        self._controls.add(self._step, chunk)

    def advance(self) -> None:
        """Carry the next command out and judge."""
        command = self._controls.command(self._step)
        if not _usable(command):
            self._end(BAD_ACTION)
            return
        self._step += 1
        try:
            self._env.step(command)
        except UnstablePhysicsError:
            self._end(UNSTABLE)
            return
        self._watch()
        verdict = self._judge.look()
        if verdict is not None:
            self._end(verdict)
        elif self._step >= self._limit:
            self._end(TIME_OUT)

    def _end(self, reason: str) -> None:
        self.outcome = Outcome(success=not reason, reason=reason, steps=self._step)


def run_trials(trials: Mapping[int, Trial], predictor: Predictor, rows: int) -> None:
    """Run trials to their ends.

    Args:
        trials: Each by its row of the batch, 0 to ``rows`` - 1.
        predictor: The policy.
        rows: Rows of every batch; those without a trial are filled up.
    """
    while running := {row: trial for row, trial in trials.items() if trial.outcome is None}:
        looking = {row: trial for row, trial in running.items() if trial.wants_chunk}
        if looking:
            chunks = _predict(looking, predictor, rows)
            for row, trial in looking.items():
                trial.take(chunks[row])
        for trial in running.values():
            trial.advance()


def _predict(looking: Mapping[int, Trial], predictor: Predictor, rows: int) -> NDArray[np.float32]:
    """(rows, K, 8 x hands) commands; only the rows that look mean anything."""
    seen = {row: trial.observe() for row, trial in looking.items()}
    filler = next(iter(seen.values()))
    of_row = [seen.get(row, filler) for row in range(rows)]
    images = {name: np.stack([frames[name] for _, frames in of_row]) for name in predictor.features.cameras}
    return np.asarray(predictor.predict(np.stack([pose for pose, _ in of_row]), images))


def _strategy(config: EvaluateConfig) -> TemporalEnsemble | OpenLoop:
    if config.ensembling is None:
        return OpenLoop(config.execute)
    return TemporalEnsemble(config.ensembling)


def _usable(command: NDArray[np.float32]) -> bool:
    """Finite, with quaternions that have a direction."""
    quaternions = command.reshape(-1, POSE_SIZE)[:, 3:7]
    return bool(np.isfinite(command).all() and (np.linalg.norm(quaternions, axis=1) > 1e-3).all())


def _look_away() -> None:
    """Nobody films."""
