"""The training loop: deterministic, and exact after a kill at any moment. It knows no policy by name."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain
from math import isfinite
from typing import TYPE_CHECKING, Any, cast

import torch

from geoprior.errors import DataError, NumericalError
from geoprior.files import finite, read_json, write_json
from geoprior.hooks.manager import plugins
from geoprior.hooks.types import TrainStep
from geoprior.policies.checkpoint import (
    CheckpointHeader,
    checkpoint_path,
    lasting_tensors,
    list_checkpoints,
    save_checkpoint,
)
from geoprior.progress import Track, track
from geoprior.training.average import WeightAverage
from geoprior.training.compiling import compile_loss
from geoprior.training.machine import arithmetic
from geoprior.training.optimise import make_optimizer, remedy, take_step
from geoprior.training.order import steps_until
from geoprior.training.resume import (
    RESUME_NAME,
    Progress,
    load_average,
    load_progress,
    require_same_training,
    save_progress,
    saved_step,
)
from geoprior.training.team import Team

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor, nn

    from geoprior.policies.policy import Batch, Policy
    from geoprior.training.config import TrainConfig
    from geoprior.training.data import Batches
    from geoprior.training.judge import Judge
    from geoprior.training.machine import Machine

RESULT_NAME = "result.json"
_MEMORY = 50
"""Steps that the running means look back on."""


@dataclass(frozen=True)
class Training:
    """Everything that one training is made of.

    Attributes:
        run: Its name, for the hooks and the progress line.
        folder: Where it writes; nothing else writes there.
        config: The common fields.
        policy: A `geoprior.policies.policy.Policy`, with its first weights.
        batches: What it learns from.
        episodes: That it learns from; an epoch has one sample of each.
        seed: Decides what is random inside a step.
        machine: Precision and threads.
        header: What the checkpoints say; epoch and step are filled in.
        fingerprint: Of all that decides the weights at the end.
        team: The processes that take part.
        judges: What it is judged by at every checkpoint, one after the other.
        is_enough: Whether the training may end at a checkpoint for what its judges say there.
        quiet: Whether it shows no progress of its own.
    """

    run: str
    folder: Path
    config: TrainConfig
    policy: nn.Module
    batches: Batches
    episodes: int
    seed: int
    machine: Machine
    header: CheckpointHeader
    fingerprint: str
    team: Team = field(default_factory=Team)
    judges: Sequence[Judge] = ()
    is_enough: Callable[[Mapping[str, float]], bool] | None = None
    quiet: bool = False

    @cached_property
    def loss(self) -> Callable[[Batch], tuple[Tensor, Mapping[str, Tensor]]]:
        """The policy's, compiled where the config says so."""
        plain = cast("Policy", self.policy).loss
        return compile_loss(plain) if self.config.compile else plain

    @property
    def steps(self) -> int:
        """Optimiser steps in all."""
        return steps_until(self.config.epochs, self.episodes, self.config.batch_size)


def fit(training: Training) -> dict[str, Any]:
    """Train to the end, from where the folder says that an earlier process got.

    Returns:
        What stands in ``result.json``: epochs, steps, samples, wall seconds, and the running means of the
        metrics at the end.

    Raises:
        NumericalError: A loss or a weight is not finite; the last state that was saved is kept.
        DataError: The folder holds another training, or a file is damaged or cannot be written.
    """
    result: dict[str, Any] | None = training.team.agree(lambda: _finished(training))
    if result is not None:
        return result
    if training.team.leads:
        training.folder.mkdir(parents=True, exist_ok=True)
        _sweep(training.folder)
    with arithmetic(training.machine):
        result = _run(training)
    if training.team.leads:
        write_json(training.folder / RESULT_NAME, result)
        (training.folder / RESUME_NAME).unlink(missing_ok=True)
    return result


def _finished(training: Training) -> dict[str, Any] | None:
    """What an earlier call returned, if all that it made is still there; else what is stale is removed."""
    path = training.folder / RESULT_NAME
    if not path.exists():
        _drop_state_past_lost_checkpoints(training)
        return None
    result: dict[str, Any] = read_json(path)
    require_same_training(path, result.get("fingerprint"), training.fingerprint)
    (training.folder / RESUME_NAME).unlink(missing_ok=True)
    if _has_checkpoints(training, int(result["steps"])):
        return result
    path.unlink()
    return None


def _drop_state_past_lost_checkpoints(training: Training) -> None:
    """From such a state a training would go on and never make them again."""
    step = saved_step(training.folder)
    if step is not None and not _has_checkpoints(training, step):
        (training.folder / RESUME_NAME).unlink()


def _has_checkpoints(training: Training, step: int) -> bool:
    """Whether those that are due by a step are there."""
    kept = {checkpoint.epoch for checkpoint in list_checkpoints(training.folder)}
    due = _checkpoint_steps(training)
    return kept.issuperset(chain(*(epochs for at, epochs in due.items() if at <= step)))


def _shown(training: Training, done: int) -> AbstractContextManager[Track]:
    total = training.steps * training.config.batch_size
    quiet = training.quiet or not training.team.leads
    return track(training.run, total, "samples", done, quiet=quiet)


def _sweep(folder: Path) -> None:
    """Remove what a killed write left: our temporary files and those of safetensors."""
    for pattern in (".*.tmp", ".tmp*"):
        for leftover in folder.glob(pattern):
            leftover.unlink(missing_ok=True)


def _run(training: Training) -> dict[str, Any]:
    config, policy = training.config, training.policy.to(training.machine.device).train()
    optimizer = make_optimizer(config, policy, training.machine)
    progress = load_progress(training.folder, training.fingerprint, policy, optimizer) or Progress(0, 0.0, {})
    _require_same_start(training, progress.step)
    optimizer.refresh()
    average = _begin_average(training, progress.step)
    lasting = average.policy if average else policy
    saved = time.monotonic()
    begun = saved - progress.seconds
    due = _checkpoint_steps(training)
    judged: dict[str, float] | None = None
    batch_size, parts = config.batch_size, training.team.share_of(config.microbatches)
    with (
        closing(training.batches.stream(progress.step, training.steps, parts)) as batches,
        _shown(training, progress.step * batch_size) as shown,
    ):
        while progress.step < training.steps:
            if progress.step in due and _is_enough(training, lasting, judged):
                break
            mine = {part: next(batches) for part in parts}
            metrics = take_step(training, optimizer, progress.step, mine)
            averages = _average(progress.averages, metrics, progress.step)
            now = time.monotonic()
            progress = Progress(progress.step + 1, now - begun, averages)
            shown.advance(
                batch_size, **{name: f"{averages[name]:.4f}" for name in ("l1",) if name in averages}
            )
            if not training.team.leads:
                continue
            if average:
                average.update(policy, progress.step)
            judged = _judge(training, lasting) if progress.step in due else {}
            _log(training, progress.step, {**metrics, **judged}, always=bool(judged))
            for epoch in due.get(progress.step, ()):
                _save_weights(training, lasting, epoch, progress.step)
            if progress.step in due or now - saved >= config.resume_seconds:
                _require_finite_weights(training, progress.step)
                save_progress(training.folder, training.fingerprint, progress, policy, optimizer, average)
                saved = time.monotonic()
    return {
        "fingerprint": training.fingerprint,
        "epochs": max(chain(*(epochs for at, epochs in due.items() if at <= progress.step))),
        "steps": progress.step,
        "samples": progress.step * batch_size,
        "seconds": round(progress.seconds, 3),
        "metrics": finite({**progress.averages, **(_judge(training, lasting) if judged is None else judged)}),
    }


def _require_same_start(training: Training, step: int) -> None:
    """All processes go on from the leader's step, with its weights."""
    leaders = training.team.agree(lambda: step)
    if step != leaders:
        raise DataError(
            f"{training.folder}: this process finds a state of step {step} here, the first one of {leaders}",
            "let all machines share the run folder",
        )


def _begin_average(training: Training, step: int) -> WeightAverage | None:
    """The leader's average of the weights, from where the folder says that an earlier process got."""
    if not training.config.average or not training.team.leads:
        return None
    average = WeightAverage(training.policy, training.config.average, step)
    load_average(training.folder, average.policy)
    return average


def _judge(training: Training, policy: nn.Module) -> dict[str, float]:
    if not training.team.leads:
        return {}
    measured: dict[str, float] = {}
    for judge in training.judges:
        measured |= judge.measure(policy, training.machine)
    return measured


def _is_enough(training: Training, policy: nn.Module, judged: Mapping[str, float] | None) -> bool:
    """The same in all processes; a training that was resumed at a checkpoint is judged again."""
    enough = training.is_enough
    if enough is None:
        return False
    said: bool = training.team.agree(lambda: enough(_judge(training, policy) if judged is None else judged))
    return said


def _average(averages: Mapping[str, float], metrics: Mapping[str, float], step: int) -> dict[str, float]:
    """The plain mean of the first steps, then an exponential one, of the numbers that are finite."""
    weight = 1.0 / min(step + 1, _MEMORY)
    return {**averages} | {
        name: (1.0 - weight) * averages.get(name, value) + weight * value
        for name, value in metrics.items()
        if isfinite(value)
    }


def _checkpoint_steps(training: Training) -> dict[int, list[int]]:
    """Epochs to save after each optimiser step."""
    config = training.config
    every = config.checkpoint_every or config.epochs
    due: dict[int, list[int]] = {}
    for epoch in sorted({*range(every, config.epochs, every), config.epochs}):
        due.setdefault(steps_until(epoch, training.episodes, config.batch_size), []).append(epoch)
    return due


def _save_weights(training: Training, policy: nn.Module, epoch: int, step: int) -> None:
    _require_finite_weights(training, step)
    header = replace(training.header, epoch=epoch, step=step)
    save_checkpoint(checkpoint_path(training.folder, epoch), lasting_tensors(policy), header)


def _require_finite_weights(training: Training, step: int) -> None:
    for name, parameter in training.policy.named_parameters():
        if not torch.isfinite(parameter).all():
            raise NumericalError(
                f"{training.run}: the weight {name!r} is not finite after step {step}",
                remedy(training.folder),
            )


def _log(training: Training, step: int, metrics: Mapping[str, float], *, always: bool) -> None:
    if step % training.config.log_every and step != training.steps and not always:
        return
    event = TrainStep(
        run=training.run,
        step=step,
        steps=training.steps,
        epoch=step * training.config.batch_size / training.episodes,
        metrics=metrics,
        folder=training.folder,
    )
    plugins().hook.geoprior_train_step(event=event)
