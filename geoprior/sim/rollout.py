"""The stage that rolls every checkpoint out on the same initial states."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from geoprior.errors import ConfigError, DataError
from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice
from geoprior.policies.checkpoint import (
    list_checkpoints,
    load_half_predictor,
    load_predictor,
    weights_digest,
)
from geoprior.progress import track
from geoprior.sim.config import SIMULATION_RATE, EvaluateConfig
from geoprior.sim.records import TrialRecord, append_record, read_records, write_records
from geoprior.sim.workers import Setup, environments
from geoprior.view.film import write_film

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from geoprior.hooks.types import Executor
    from geoprior.policies.policy import Predictor
    from geoprior.sim.environment import Environment
    from geoprior.sim.trial import Trial

ROLLOUTS = "rollouts.jsonl"
FILMS = "films"
DIGITS = 16
"""Of a digest of weights, in a record."""
Loader = Callable[[Path], "Predictor"]
LOADERS: dict[str, Loader] = {"fp32": load_predictor, "bf16": load_half_predictor}
"""By `EvaluateConfig.precision`."""
_TRAINING = re.compile(r"(?P<condition>.+)-s(?P<seed>\d+)")


@dataclass(frozen=True, order=True)
class CheckpointRef:
    """A checkpoint and what it stands for.

    Attributes:
        condition: What the fine-tuning started from, for example ``scratch`` or ``prior``.
        training_seed: Of the fine-tuning.
        epoch: Of the checkpoint.
        path: Of its weights.
        weights: The first digits of their SHA-256; empty where nobody knows.
    """

    condition: str
    training_seed: int
    epoch: int
    path: Path
    weights: str = ""


@dataclass(frozen=True)
class TrialGroup:
    """Some trials of one checkpoint: a unit of work that any process can do.

    Attributes:
        checkpoint: Whose trials they are.
        states: Initial states; no two of them share a row of the batch, which is the state modulo its rows.
        config: How they are run.
        setup: What is simulated.
        films: Where to put a film of a state, by the state.
        load: Loads a checkpoint; importable.
    """

    checkpoint: CheckpointRef
    states: tuple[int, ...]
    config: EvaluateConfig
    setup: Setup
    films: Mapping[int, Path]
    load: Loader


def find_checkpoints(folder: Path) -> tuple[CheckpointRef, ...]:
    """The checkpoints of all trainings in a folder, whose sub-folders are named ``CONDITION-sSEED``.

    Raises:
        DataError: There is none, or one is damaged.
    """
    found = [
        CheckpointRef(
            match["condition"],
            int(match["seed"]),
            checkpoint.epoch,
            checkpoint.path,
            weights_digest(checkpoint.path)[:DIGITS],
        )
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
    load: Loader | None = None,
) -> Mapping[str, Any]:
    """Run every trial that ``rollouts.jsonl`` does not hold yet, or whose film is lost.

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
        load: Loads a checkpoint; by default as the config's precision wants it.

    Returns:
        ``trials`` and ``successes``.

    Raises:
        DataError: The records are of another evaluation, or a checkpoint cannot be used.
        MachineError: No GL, or a worker died.
    """
    path, setup = out / ROLLOUTS, Setup(robot, task, cameras, config.look)
    planned = [(ref, state) for ref in sorted(checkpoints) for state in config.states]
    records = {record.key: record for record in read_records(path) if _has_film(record, out)}
    _refuse_foreign(path, {_key(ref, state): ref for ref, state in planned}, setup, records.values())
    missing = [(ref, state) for ref, state in planned if _key(ref, state) not in records]
    films = _films(config, checkpoints, out)
    groups = [
        TrialGroup(
            ref,
            states,
            config,
            setup,
            {state: films[ref, state] for state in states if (ref, state) in films},
            load or LOADERS[config.precision],
        )
        for ref, states in _grouped(missing, config.batch)
    ]
    with track("evaluate", len(planned), "trials", done=len(records)) as progress:
        for _, finished in executor.run(roll_out, groups):
            for record in finished:
                append_record(path, record)
                records[record.key] = record
                progress.advance(condition=record.condition, epoch=record.epoch)
    write_records(path, records.values())
    (out / FILMS).mkdir(exist_ok=True)
    return {"trials": len(records), "successes": sum(record.success for record in records.values())}


def roll_out(group: TrialGroup) -> list[TrialRecord]:
    """Run some trials side by side; their films, if any are wanted, are on disk when this returns."""
    from geoprior.sim.trial import run_trials

    with _one_thread():
        predictor = _predictor(group.load, group.checkpoint.path)
        rate = _control_rate(group.checkpoint, predictor)
        pool = environments(group.setup, rate, len(group.states))
        _require_same_body(group.checkpoint, predictor, pool[0])
        shows: dict[int, list[Any]] = {state: [] for state in group.films}
        trials = {
            state: _begin(group, env, state, shows.get(state))
            for state, env in zip(group.states, pool, strict=True)
        }
        rows = group.config.batch
        run_trials({state % rows: trial for state, trial in trials.items()}, predictor, rows)
    for state, frames in shows.items():
        write_film(group.films[state], frames, rate)
    return [_record(group, state, trial, rate) for state, trial in trials.items()]


def _begin(group: TrialGroup, env: Environment, state: int, frames: list[Any] | None) -> Trial:
    from geoprior.sim.trial import Trial

    def film() -> None:
        assert frames is not None
        frames.append(env.film_frame(group.config.film_size))

    return Trial(env, group.config, state, on_step=None if frames is None else film)


def _record(group: TrialGroup, state: int, trial: Trial, rate: int) -> TrialRecord:
    outcome, ref = trial.outcome, group.checkpoint
    assert outcome is not None
    return TrialRecord(
        robot=group.setup.robot.name,
        task=group.setup.task.name,
        condition=ref.condition,
        training_seed=ref.training_seed,
        epoch=ref.epoch,
        state_seed=state,
        success=outcome.success,
        reason=outcome.reason,
        steps=outcome.steps,
        seconds=outcome.steps / rate,
        film=f"{FILMS}/{group.films[state].name}" if state in group.films else "",
        look=group.setup.look.name,
        weights=ref.weights,
    )


def _key(ref: CheckpointRef, state: int) -> tuple[str, int, int, int]:
    """As `TrialRecord.key`."""
    return ref.condition, ref.training_seed, ref.epoch, state


def _grouped(
    missing: Sequence[tuple[CheckpointRef, int]], rows: int
) -> Iterator[tuple[CheckpointRef, tuple[int, ...]]]:
    """Trials side by side: of one checkpoint, and with rows of their own in the batch.

    Checkpoint after checkpoint: a worker then seldom loads another one.
    """
    for (ref, _), trials in groupby(missing, key=lambda trial: (trial[0], trial[1] // rows)):
        yield ref, tuple(state for _, state in trials)


def _films(
    config: EvaluateConfig, checkpoints: Sequence[CheckpointRef], out: Path
) -> dict[tuple[CheckpointRef, int], Path]:
    """Films of the first trials of every condition: of its first training seed's last checkpoint."""
    shown: dict[str, CheckpointRef] = {}
    for ref in sorted(checkpoints, key=lambda ref: (-ref.training_seed, ref.epoch)):
        shown[ref.condition] = ref
    return {
        (ref, state): out
        / FILMS
        / f"{ref.condition}-s{ref.training_seed}-epoch-{ref.epoch:06d}-state-{state}.webm"
        for ref in shown.values()
        for state in config.states[: config.films]
    }


def _has_film(record: TrialRecord, out: Path) -> bool:
    """Whether the film that it names is there, if it names one."""
    return not record.film or (out / record.film).is_file()


def _refuse_foreign(
    path: Path,
    planned: Mapping[tuple[str, int, int, int], CheckpointRef],
    setup: Setup,
    records: Iterable[TrialRecord],
) -> None:
    names = (setup.robot.name, setup.task.name, setup.look.name)
    for record in records:
        if record.key not in planned or (record.robot, record.task, record.look) != names:
            raise DataError(
                f"{path}: holds a trial that is not wanted: {record.task} on {record.robot}, look "
                f"{record.look}, {record.condition}, training seed {record.training_seed}, epoch "
                f"{record.epoch}, initial state {record.state_seed}",
                "delete the file, or choose another folder",
            )
        ref = planned[record.key]
        if record.weights != ref.weights:
            raise DataError(
                f"{path}: holds trials of other weights ({record.weights or 'not said which'}) than those of "
                f"{ref.path} ({ref.weights or 'not said which'})",
                "delete the file to roll these weights out",
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
    return rate


def _require_same_body(checkpoint: CheckpointRef, predictor: Predictor, env: Environment) -> None:
    """The policy must move the hands that there are, and look through cameras that are there."""
    hands, seen = predictor.features.hands, {camera.name for camera in env.camera_headers()}
    if hands != env.hands:
        raise DataError(
            f"{checkpoint.path}: the policy moves {', '.join(hands)} and task {env.task.name!r} has "
            f"{', '.join(env.hands)}, in this order"
        )
    if not seen.issuperset(predictor.features.cameras):
        raise DataError(
            f"{checkpoint.path}: the policy looks through {', '.join(predictor.features.cameras)} and task "
            f"{env.task.name!r} has {', '.join(sorted(seen))}"
        )


@contextmanager
def _one_thread() -> Iterator[None]:
    """One thread for torch: the workers share the cores, and sums do not depend on their number."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
