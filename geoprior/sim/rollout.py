"""The stage that rolls every checkpoint out on the same initial states."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from geoprior.errors import ConfigError, DataError
from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice
from geoprior.policies.checkpoint import list_checkpoints, load_predictor
from geoprior.progress import track
from geoprior.shards.episode import POSE_SIZE
from geoprior.sim.config import SIMULATION_RATE, EvaluateConfig
from geoprior.sim.records import TrialRecord, append_record, read_records, write_records
from geoprior.sim.workers import environment
from geoprior.view.film import write_film

if TYPE_CHECKING:
    from collections.abc import Iterator

    from geoprior.hooks.types import Executor
    from geoprior.policies.policy import Predictor

ROLLOUTS = "rollouts.jsonl"
FILMS = "films"
Loader = Callable[[Path], "Predictor"]
_TRAINING = re.compile(r"(?P<condition>.+)-s(?P<seed>\d+)")


@dataclass(frozen=True, order=True)
class CheckpointRef:
    """A checkpoint and what it stands for.

    Attributes:
        condition: What the fine-tuning started from, for example ``scratch`` or ``prior``.
        training_seed: Of the fine-tuning.
        epoch: Of the checkpoint.
        path: Of its weights.
    """

    condition: str
    training_seed: int
    epoch: int
    path: Path


@dataclass(frozen=True)
class TrialTask:
    """One trial: a unit of work that any process can do.

    Attributes:
        checkpoint: Whose trial it is.
        state_seed: Initial state.
        config: How it is run.
        robot: Choice of the arm.
        task: Choice of the task.
        cameras: Lenses and size of the frames.
        film: Where to put a film of it, or None.
        load: Loads a checkpoint; importable.
    """

    checkpoint: CheckpointRef
    state_seed: int
    config: EvaluateConfig
    robot: Choice
    task: Choice
    cameras: CamerasConfig
    film: Path | None
    load: Loader

    @property
    def key(self) -> tuple[str, int, int, int]:
        """As `TrialRecord.key`."""
        ref = self.checkpoint
        return ref.condition, ref.training_seed, ref.epoch, self.state_seed


def find_checkpoints(folder: Path) -> tuple[CheckpointRef, ...]:
    """The checkpoints of all trainings in a folder, whose sub-folders are named ``CONDITION-sSEED``.

    Raises:
        DataError: There is none.
    """
    found = [
        CheckpointRef(match["condition"], int(match["seed"]), checkpoint.epoch, checkpoint.path)
        for training in sorted(folder.glob("*/"))
        if (match := _TRAINING.fullmatch(training.name))
        for checkpoint in list_checkpoints(training)
    ]
    if not found:
        raise DataError(f"{folder}: there are no checkpoints to roll out", "run `geoprior finetune` first")
    return tuple(sorted(found))


def evaluate(
    config: EvaluateConfig,
    *,
    robot: Choice,
    task: Choice,
    cameras: CamerasConfig,
    seed: int,  # noqa: ARG001 - of the stages' common signature; a rollout draws nothing at random
    checkpoints: Sequence[CheckpointRef],
    executor: Executor,
    out: Path,
    load: Loader = load_predictor,
) -> Mapping[str, Any]:
    """Run every trial that ``rollouts.jsonl`` does not hold yet.

    Every checkpoint meets the same initial states, so that conditions can be compared in pairs. A trial
    that goes wrong is a failure with a reason; only a fault of the machine stops the stage, and the same
    call then goes on.

    Args:
        config: How many trials, and how they are run.
        robot: Choice of the arm.
        task: Choice of the task.
        cameras: Lenses and size of the frames; must be those of the training.
        seed: Root seed.
        checkpoints: What to roll out.
        executor: Runs trials side by side; the records do not depend on it.
        out: Run folder, for ``rollouts.jsonl`` and ``films/``.
        load: Loads a checkpoint.

    Returns:
        ``trials`` and ``successes``.

    Raises:
        DataError: The records are of another evaluation, or a checkpoint cannot be used.
        MachineError: No GL, or a worker died.
    """
    path = out / ROLLOUTS
    tasks = _plan(config, robot, task, cameras, checkpoints, out, load)
    records = {record.key: record for record in read_records(path)}
    _refuse_foreign(path, tasks, records)
    missing = [each for each in tasks if each.key not in records]
    with track("evaluate", len(tasks), "trials", done=len(records)) as progress:
        for _, record in executor.run(roll_out, missing):
            append_record(path, record)
            records[record.key] = record
            progress.advance(condition=record.condition, epoch=record.epoch)
    write_records(path, records.values())
    (out / FILMS).mkdir(exist_ok=True)
    return {"trials": len(records), "successes": sum(record.success for record in records.values())}


def roll_out(task: TrialTask) -> TrialRecord:
    """Run one trial; its film, if one is wanted, is on disk when this returns."""
    from geoprior.sim.trial import run_trial

    with _one_thread():
        predictor = _predictor(task.load, task.checkpoint.path)
        env = environment(task.robot, task.task, task.cameras, _control_rate(task.checkpoint, predictor))
        frames: list[Any] = []
        film = None if task.film is None else lambda: frames.append(env.film_frame(task.config.film_size))
        outcome = run_trial(env, predictor, task.config, task.state_seed, on_step=film)
    if task.film is not None:
        write_film(task.film, frames, env.control_rate)
    return TrialRecord(
        robot=task.robot.name,
        task=task.task.name,
        condition=task.checkpoint.condition,
        training_seed=task.checkpoint.training_seed,
        epoch=task.checkpoint.epoch,
        state_seed=task.state_seed,
        success=outcome.success,
        reason=outcome.reason,
        steps=outcome.steps,
        seconds=outcome.steps / env.control_rate,
        film="" if task.film is None else f"{FILMS}/{task.film.name}",
    )


def _plan(
    config: EvaluateConfig,
    robot: Choice,
    task: Choice,
    cameras: CamerasConfig,
    checkpoints: Sequence[CheckpointRef],
    out: Path,
    load: Loader,
) -> list[TrialTask]:
    """All trials, checkpoint by checkpoint: a worker then seldom loads another one."""
    last = {(ref.condition, ref.training_seed): ref.epoch for ref in sorted(checkpoints)}
    filmed_seed = {ref.condition: ref.training_seed for ref in sorted(checkpoints, reverse=True)}

    def film(ref: CheckpointRef, state: int) -> Path | None:
        chosen = (
            ref.training_seed == filmed_seed[ref.condition]
            and ref.epoch == last[ref.condition, ref.training_seed]
            and state in config.states[: config.films]
        )
        name = f"{ref.condition}-s{ref.training_seed}-epoch-{ref.epoch:06d}-state-{state}.webm"
        return out / FILMS / name if chosen else None

    return [
        TrialTask(ref, state, config, robot, task, cameras, film(ref, state), load)
        for ref in sorted(checkpoints)
        for state in config.states
    ]


def _refuse_foreign(
    path: Path, tasks: Sequence[TrialTask], records: Mapping[tuple[str, int, int, int], TrialRecord]
) -> None:
    planned = {task.key for task in tasks}
    names = {(task.robot.name, task.task.name) for task in tasks}
    for record in records.values():
        if record.key not in planned or (record.robot, record.task) not in names:
            raise DataError(
                f"{path}: holds a trial that is not wanted: {record.task} on {record.robot}, "
                f"{record.condition}, training seed {record.training_seed}, epoch {record.epoch}, "
                f"initial state {record.state_seed}",
                "delete the file, or choose another folder",
            )


@lru_cache(maxsize=1)
def _predictor(load: Loader, path: Path) -> Predictor:
    return load(path)


def _control_rate(checkpoint: CheckpointRef, predictor: Predictor) -> int:
    rate = round(predictor.fps)
    if abs(rate - predictor.fps) > 1e-6 or rate < 1 or SIMULATION_RATE % rate:
        raise ConfigError(
            f"{checkpoint.path}: the policy acts {predictor.fps:g} times a second, and the physics' "
            f"{SIMULATION_RATE} steps a second cannot be shared out evenly",
            "train at 10, 20, 25 or 50 actions a second: demos.control_rate / finetune.skip",
        )
    if predictor.features.pose_size != POSE_SIZE:
        raise DataError(
            f"{checkpoint.path}: the policy moves {predictor.features.pose_size // POSE_SIZE} hands and the "
            "robot has one"
        )
    return rate


@contextmanager
def _one_thread() -> Iterator[None]:
    """One thread for torch: the workers share the cores, and sums do not depend on their number."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
