"""The two training stages: functions of files to files."""

from __future__ import annotations

from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import torch

from geoprior.errors import ConfigError, DataError, PluginError
from geoprior.executors.local import SerialExecutor
from geoprior.files import sha256_json
from geoprior.geometry.seeding import integer_seed
from geoprior.hooks.manager import plugins
from geoprior.options import recipe_tree
from geoprior.policies.checkpoint import (
    CheckpointHeader,
    load_weights,
    read_header,
)
from geoprior.policies.imagenet import load_imagenet_trunk
from geoprior.policies.normalise import Normaliser, Statistics, merge
from geoprior.policies.policy import PolicyOptions
from geoprior.shards.reader import EpisodeStore
from geoprior.sources.blind import BlindSource
from geoprior.sources.shards import ShardSource
from geoprior.sources.source import SourceContext, targets_of
from geoprior.training.config import END_FIELDS, ConditionConfig, TrainConfig
from geoprior.training.data import Batches, features_of, split_slots, statistics_of
from geoprior.training.held_out import HeldOut
from geoprior.training.judge import Taught, has_vision_gain
from geoprior.training.loop import Training, fit
from geoprior.training.machine import Machine, decide_machine, require_device
from geoprior.training.memory import release_memory
from geoprior.training.priors import BLIND, find_prior
from geoprior.training.side_by_side import run_side_by_side
from geoprior.training.team import team

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from torch import nn

    from geoprior.geometry.camera import CamerasConfig
    from geoprior.hooks.types import Executor
    from geoprior.options import Choice
    from geoprior.policies.policy import Features
    from geoprior.sources.source import Source
    from geoprior.synthesis.config import GenerateConfig
    from geoprior.training.config import FinetuneConfig, PretrainConfig
    from geoprior.training.judge import Judge, JudgeMaker

_MACHINES = frozenset({"threads", "precision", "device"})
"""Fields that say what the machine shall be; what it is decides."""


@dataclass(frozen=True)
class Job:
    """One training to set up.

    Attributes:
        run: Its name.
        seed: Decides the first weights, the order of samples and all noise.
        condition: How it begins.
        prior: The checkpoint that it takes weights or statistics from, if any.
        folder: Where it writes.
        judge: Makes a judge of it, besides that of the held-out episodes.
    """

    run: str
    seed: int
    condition: ConditionConfig
    prior: Path | None
    folder: Path
    judge: JudgeMaker | None = None


@dataclass(frozen=True)
class Work:
    """A training for whatever process does it.

    Attributes:
        config: The common fields.
        job: What is trained.
        policy: What learns.
        source: Opens what it learns from; can be pickled.
        machine: How the arithmetic is done.
    """

    config: TrainConfig
    job: Job
    policy: Choice
    source: Callable[[], AbstractContextManager[Source]]
    machine: Machine


def pretrain(
    config: PretrainConfig,
    *,
    policy: Choice,
    seed: int,
    data: Path,
    generate: GenerateConfig,
    cameras: CamerasConfig,
    out: Path,
    judge: JudgeMaker | None = None,
    blind: bool = False,
    executor: Executor | None = None,
) -> dict[str, Any]:
    """Train on the geometric data set.

    Args:
        config: See `PretrainConfig`.
        policy: What learns.
        seed: Root seed of the run.
        data: Folder of shards.
        generate: What they were made from.
        cameras: The same.
        out: Gets ``epoch-*.safetensors`` and their JSON, ``log.jsonl``, ``machine.json``, ``result.json``.
        judge: Makes what the policy is judged by at every checkpoint, besides held-out episodes.
        blind: Whether a second prior is trained, into ``out/blind``: the same but for its frames, all black.
        executor: Runs the two side by side where each takes one thread; by default this process does.

    Returns:
        Epochs, steps, samples, wall seconds and the running means of the metrics at the end; the same for the
        blind prior under ``blind``.

    Raises:
        GeopriorError: See `geoprior.training.loop.fit`.
    """
    context = SourceContext(data, generate, cameras, seed, config.frame_cache_mb * 2**20)
    begin = ConditionConfig(init=config.init)
    machine = _machine(config, out, trainings=2 if blind else 1)
    job_seed = integer_seed(seed, "pretrain")

    def work(run: str, folder: Path, *, black: bool) -> Work:
        job = Job(run, job_seed, begin, None, folder, None if black else judge)
        source = partial(_episodes, config.source, context, policy, blind=black)
        return Work(config, job, policy, source, machine)

    works = [work("pretrain", out, black=False)]
    if blind:
        works.append(work(f"pretrain/{BLIND}", out / BLIND, black=True))
    results = _train_all("pretrain", works, executor)
    return results[0] | ({BLIND: results[1]} if blind else {})


def finetune(
    config: FinetuneConfig,
    *,
    policy: Choice,
    seed: int,
    demos: Path,
    prior: Path | None,
    out: Path,
    executor: Executor | None = None,
) -> dict[str, Any]:
    """Train on the demonstrations, for every condition and training seed.

    The first weights, the order of samples and all noise depend on the root seed and the training seed
    and not on the condition: the conditions are paired.

    Args:
        config: See `FinetuneConfig`.
        policy: What learns; for a prior's weights it must have the prior's sizes.
        seed: Root seed of the run.
        demos: Folder of shards.
        prior: Folder of pretraining, whose last checkpoint is taken.
        out: Gets one folder ``{condition}-s{training seed}`` each.
        executor: Runs the trainings side by side where each takes one thread; by default this process does
            one after the other. The weights are the same to the bit.

    Returns:
        For each folder's name what `pretrain` returns.

    Raises:
        GeopriorError: See `geoprior.training.loop.fit`; and where a prior is missing or does not fit.
    """
    digest = EpisodeStore(demos).digest
    source = partial(_demonstrations, demos, config.frame_cache_mb * 2**20, digest)
    machine = _machine(config, out, trainings=len(config.conditions) * len(config.seeds))
    works = []
    for name, condition in config.conditions.items():
        checkpoint = find_prior(name, condition, prior)
        for training_seed in config.seeds:
            folder = out / f"{name}-s{training_seed}"
            run_seed = integer_seed(seed, "finetune", training_seed)
            job = Job(f"finetune/{folder.name}", run_seed, condition, checkpoint, folder)
            works.append(Work(config, job, policy, source, machine))
    try:
        results = _train_all("finetune", works, executor)
    finally:
        _kept_demonstrations.cache_clear()
    return {work.job.folder.name: result for work, result in zip(works, results, strict=True)}


def _train_all(label: str, works: Sequence[Work], executor: Executor | None) -> list[dict[str, Any]]:
    """Side by side where each takes one thread of a CPU, else one after the other.

    Trainings of more threads would have to share the cores, and those of torchrun have its processes.
    """
    machine = works[0].machine
    if len(works) == 1 or machine.device != "cpu" or machine.threads != 1 or team().size > 1:
        return [_do(work) for work in works]
    return run_side_by_side(
        label,
        partial(_do, quiet=True),
        works,
        folders=[work.job.folder for work in works],
        epochs=works[0].config.epochs,
        executor=executor or SerialExecutor(),
    )


def _do(work: Work, *, quiet: bool = False) -> dict[str, Any]:
    with work.source() as source:
        result = train(work.config, work.job, work.policy, source, work.machine, quiet=quiet)
    del source
    release_memory()
    return result


@contextmanager
def _episodes(choice: Choice, context: SourceContext, policy: Choice, *, blind: bool) -> Iterator[Source]:
    with closing(plugins().build("source", choice, context)) as source:
        _require_targets(policy, source)
        yield BlindSource(source) if blind else source


@contextmanager
def _demonstrations(folder: Path, cache_bytes: int, digest: str) -> Iterator[Source]:
    yield _kept_demonstrations(folder, cache_bytes, digest)


@lru_cache(maxsize=1)
def _kept_demonstrations(folder: Path, cache_bytes: int, digest: str) -> ShardSource:  # noqa: ARG001
    """A process reads them once for all of its trainings; the digest tells when the folder has others."""
    return ShardSource(EpisodeStore(folder), cache_bytes)


def train(
    config: TrainConfig, job: Job, choice: Choice, source: Source, machine: Machine, *, quiet: bool = False
) -> dict[str, Any]:
    """Set one training up and take it to its end; see `pretrain`."""
    choice = plugins().resolve("policy", choice)
    options = _options(choice)
    features = features_of(source, options.chunk, targets=options.uses_targets)
    fps = source.fps / config.skip
    slots, aside = split_slots(len(source), config.held_out, job.seed)
    _require_same_actions(job, options)
    own = partial(
        statistics_of, source, slots, actions=options.actions, chunk=options.chunk, skip=config.skip
    )
    statistics = _statistics(job, source, own)
    policy = build_policy(choice, features, job.seed)
    transfer = _transfer(job, policy, choice.name, fps)
    aside_from = set(type(config).model_fields) - set(TrainConfig.model_fields)
    common = recipe_tree(config, config.speed_only | _MACHINES | aside_from)
    deciding_options = {"name": choice.name, **recipe_tree(options)}
    details = {
        "run": job.run,
        "seed": job.seed,
        "config": common,
        "device": machine.device,
        "precision": machine.precision,
        "threads": machine.threads,
        "data": {"digest": source.digest, "episodes": len(slots)},
        "transfer": transfer,
    }
    wanted = getattr(config, "until_vision_gain", None)
    ends = {} if wanted is None else {name: getattr(config, name) for name in END_FIELDS}
    normaliser = Normaliser(statistics, actions=options.actions)
    batches = Batches(source, features, normaliser, config, job.seed, slots)
    judges: list[Judge] = []
    if aside:
        judges.append(HeldOut(source, aside, features, normaliser, config, batches.read))
    if job.judge is not None:
        judges.append(job.judge(Taught(source, slots, features, normaliser, config.skip)))
    training = Training(
        run=job.run,
        folder=job.folder,
        config=config,
        policy=policy,
        batches=batches,
        episodes=len(slots),
        seed=job.seed,
        machine=machine,
        header=CheckpointHeader(choice, replace(features, targets=()), fps, statistics, 0, 0, details),
        fingerprint=sha256_json({"policy": deciding_options, "fps": fps, **details, **ends}),
        team=team(),
        judges=judges,
        is_enough=None if wanted is None else partial(has_vision_gain, wanted),
        quiet=quiet,
    )
    return fit(training)


def _machine(config: TrainConfig, out: Path, *, trainings: int) -> Machine:
    """The same for all processes, and for all trainings of a stage, however many of them are still to do."""
    here = team()
    several = trainings > 1 and here.size == 1
    machine = Machine(
        **here.agree(lambda: asdict(decide_machine(config, out, here.local_size, side_by_side=several)))
    )
    require_device(machine.device)
    here.take(machine.device)
    return machine


def build_policy(choice: Choice, features: Features, seed: int) -> nn.Module:
    """Build a policy whose random weights depend on the seed only."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(integer_seed(seed, "init"))
        policy: nn.Module = plugins().build("policy", choice, features)
    return policy


def _options(choice: Choice) -> PolicyOptions:
    options = plugins().options("policy", choice)
    if not isinstance(options, PolicyOptions):
        raise PluginError(
            f"policy {choice.name!r}: its config model is no PolicyOptions",
            "derive it from geoprior.policies.policy.PolicyOptions",
        )
    return options


def _require_targets(choice: Choice, source: Source) -> None:
    """Refuse to pretrain a policy that would learn targets on data that have none.

    Raises:
        ConfigError: The policy is named.
    """
    if _options(choice).uses_targets and not targets_of(source):
        raise ConfigError(
            f"policy {choice.name!r}: it shall learn targets in pretraining, and the data have none",
            "set generate.targets to true and generate anew, or policy.target_weight to 0",
        )


def _require_same_actions(job: Job, options: PolicyOptions) -> None:
    """Refuse weights or statistics of actions of another kind.

    Raises:
        DataError: The prior is named.
    """
    if job.prior is None or (job.condition.weights == "trunk" and job.condition.statistics == "new"):
        return
    theirs = read_header(job.prior).actions
    if theirs != options.actions:
        raise DataError(
            f"{job.prior}: the prior's actions are {theirs}, this training's {options.actions}",
            f"set policy.actions to {theirs}, or take the trunk's weights only, with new statistics",
        )


def _statistics(job: Job, source: Source, own: Callable[[], Statistics]) -> Statistics:
    kind = job.condition.statistics
    if job.prior is None or kind == "new":
        return own()
    prior = read_header(job.prior)
    if prior.features.hands != source.hands:
        raise DataError(
            f"{job.prior}: its statistics are of the hands {', '.join(prior.features.hands)}, this data has "
            f"{', '.join(source.hands)}",
            "set the condition's statistics to new",
        )
    pretrained = Normaliser(prior.statistics).statistics
    return pretrained if kind == "pretrained" else merge(pretrained, own())


def _transfer(job: Job, policy: nn.Module, name: str, fps: float) -> dict[str, Any]:
    """Put the prior's weights into the policy; returns what was done, for the checkpoint's JSON."""
    condition = job.condition
    taken: dict[str, Any] = {"init": condition.init}
    if condition.init == "imagenet":
        taken["tensors"] = len(load_imagenet_trunk(policy, name))
    if job.prior is None:
        return taken
    header = read_header(job.prior)
    taken["statistics"] = condition.statistics
    taken["prior"] = {
        "epoch": header.epoch,
        "step": header.step,
        "fingerprint": sha256_json(header.details),
        "data": header.data,
    }
    if not condition.takes_weights:
        return taken
    if abs(header.fps - fps) > 1e-6 * fps:
        raise DataError(
            f"{job.prior}: the prior acts {header.fps:g} times a second, this training {fps:g} times",
            "a chunk would span another time; set finetune.skip or pretrain.skip so that the rates agree",
        )
    names = load_weights(policy, job.prior, condition.weights)
    return taken | {"weights": condition.weights, "tensors": len(names)}
