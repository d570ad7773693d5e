"""The two training stages: functions of files to files."""

from __future__ import annotations

from contextlib import closing
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import torch

from geoprior.errors import ConfigError, DataError, PluginError
from geoprior.files import sha256_json
from geoprior.geometry.seeding import integer_seed
from geoprior.hooks.manager import plugins
from geoprior.options import recipe_tree
from geoprior.policies.checkpoint import (
    CheckpointHeader,
    list_checkpoints,
    load_weights,
    read_header,
)
from geoprior.policies.imagenet import load_imagenet_trunk
from geoprior.policies.normalise import Normaliser, Statistics, merge
from geoprior.policies.policy import PolicyOptions
from geoprior.shards.reader import EpisodeStore
from geoprior.sources.shards import ShardSource
from geoprior.sources.source import SourceContext
from geoprior.training.config import ConditionConfig, TrainConfig
from geoprior.training.data import Batches, features_of, split_slots, statistics_of
from geoprior.training.held_out import HeldOut
from geoprior.training.judge import Taught
from geoprior.training.loop import Training, fit
from geoprior.training.machine import Machine, decide_machine, require_device
from geoprior.training.team import team

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from torch import nn

    from geoprior.geometry.camera import CamerasConfig
    from geoprior.options import Choice
    from geoprior.policies.policy import Features
    from geoprior.shards.config import GenerateConfig
    from geoprior.sources.source import Source
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
        prior: The checkpoint it may begin from.
        folder: Where it writes.
        judge: Makes a judge of it, besides that of the held-out episodes.
    """

    run: str
    seed: int
    condition: ConditionConfig
    prior: Path | None
    folder: Path
    judge: JudgeMaker | None = None


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

    Returns:
        Epochs, steps, samples, wall seconds and the running means of the metrics at the end.

    Raises:
        GeopriorError: See `geoprior.training.loop.fit`.
    """
    context = SourceContext(data, generate, cameras, seed, config.frame_cache_mb * 2**20)
    begin = ConditionConfig(init=config.init)
    job = Job("pretrain", integer_seed(seed, "pretrain"), begin, None, out, judge)
    with closing(plugins().build("source", config.source, context)) as source:
        return train(config, job, policy, source, _machine(config, out))


def finetune(
    config: FinetuneConfig, *, policy: Choice, seed: int, demos: Path, prior: Path | None, out: Path
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

    Returns:
        For each folder's name what `pretrain` returns.

    Raises:
        GeopriorError: See `geoprior.training.loop.fit`; and where a prior is missing or does not fit.
    """
    source = ShardSource(EpisodeStore(demos), config.frame_cache_mb * 2**20)
    machine = _machine(config, out)
    results = {}
    for name, condition in config.conditions.items():
        checkpoint = last_checkpoint(name, prior) if condition.init == "prior" else None
        for training_seed in config.seeds:
            folder = out / f"{name}-s{training_seed}"
            run_seed = integer_seed(seed, "finetune", training_seed)
            job = Job(f"finetune/{folder.name}", run_seed, condition, checkpoint, folder)
            results[folder.name] = train(config, job, policy, source, machine)
    return results


def train(config: TrainConfig, job: Job, choice: Choice, source: Source, machine: Machine) -> dict[str, Any]:
    """Set one training up and take it to its end; see `pretrain`."""
    choice = plugins().resolve("policy", choice)
    features = features_of(source, _chunk(choice))
    fps = source.fps / config.skip
    slots, aside = split_slots(len(source), config.held_out, job.seed)
    statistics = _statistics(job, source, slots)
    policy = build_policy(choice, features, job.seed)
    transfer = _transfer(job, policy, choice.name, fps)
    aside_from = set(type(config).model_fields) - set(TrainConfig.model_fields)
    common = recipe_tree(config, config.speed_only | _MACHINES | aside_from)
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
    normaliser = Normaliser(statistics)
    batches = Batches(source, features, normaliser, config, job.seed, slots)
    judges: list[Judge] = []
    if aside:
        judges.append(HeldOut(source, aside, features, normaliser, config, batches.read))
    if job.judge is not None:
        judges.append(job.judge(Taught(source, slots, features, statistics, config.skip)))
    training = Training(
        run=job.run,
        folder=job.folder,
        config=config,
        policy=policy,
        batches=batches,
        episodes=len(slots),
        seed=job.seed,
        machine=machine,
        header=CheckpointHeader(choice, features, fps, statistics, 0, 0, details),
        fingerprint=sha256_json({"policy": choice.model_dump(mode="json"), "fps": fps, **details}),
        team=team(),
        judges=judges,
    )
    return fit(training)


def _machine(config: TrainConfig, out: Path) -> Machine:
    """The same for all processes."""
    here = team()
    machine = Machine(**here.agree(lambda: asdict(decide_machine(config, out, here.local_size))))
    require_device(machine.device)
    here.take(machine.device)
    return machine


def build_policy(choice: Choice, features: Features, seed: int) -> nn.Module:
    """Build a policy whose random weights depend on the seed only."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(integer_seed(seed, "init"))
        policy: nn.Module = plugins().build("policy", choice, features)
    return policy


def last_checkpoint(condition: str, prior: Path | None) -> Path:
    """The checkpoint that a condition begins from.

    Raises:
        ConfigError: There is no prior.
        DataError: Its folder holds no checkpoint.
    """
    if prior is None:
        raise ConfigError(
            f"condition {condition!r} begins from a prior and none is given", "run `geoprior pretrain`"
        )
    checkpoints = list_checkpoints(prior)
    if not checkpoints:
        raise DataError(f"{prior}: no checkpoint of pretraining is here", "run `geoprior pretrain`")
    return checkpoints[-1].path


def _chunk(choice: Choice) -> int:
    options = plugins().options("policy", choice)
    if not isinstance(options, PolicyOptions):
        raise PluginError(
            f"policy {choice.name!r}: its config model is no PolicyOptions",
            "derive it from geoprior.policies.policy.PolicyOptions",
        )
    return options.chunk


def _statistics(job: Job, source: Source, slots: Sequence[int]) -> Statistics:
    kind = job.condition.statistics
    if job.prior is None or kind == "new":
        return statistics_of(source, slots)
    prior = read_header(job.prior)
    if prior.features.hands != source.hands:
        raise DataError(
            f"{job.prior}: its statistics are of the hands {', '.join(prior.features.hands)}, this data has "
            f"{', '.join(source.hands)}",
            "set the condition's statistics to new",
        )
    pretrained = Normaliser(prior.statistics).statistics
    return pretrained if kind == "pretrained" else merge(pretrained, statistics_of(source, slots))


def _transfer(job: Job, policy: nn.Module, name: str, fps: float) -> dict[str, Any]:
    """Put the prior's weights into the policy; returns what was done, for the checkpoint's JSON."""
    taken: dict[str, Any] = job.condition.model_dump(mode="json")
    if job.condition.init == "imagenet":
        return {"init": taken["init"], "tensors": len(load_imagenet_trunk(policy, name))}
    if job.prior is None:
        return {"init": taken["init"]}
    header = read_header(job.prior)
    if abs(header.fps - fps) > 1e-6 * fps:
        raise DataError(
            f"{job.prior}: the prior acts {header.fps:g} times a second, this training {fps:g} times",
            "a chunk would span another time; set finetune.skip or pretrain.skip so that the rates agree",
        )
    names = load_weights(policy, job.prior, job.condition.weights)
    taken["tensors"] = len(names)
    taken["prior"] = {
        "epoch": header.epoch,
        "step": header.step,
        "fingerprint": sha256_json(header.details),
        "data": header.data,
    }
    return taken
