"""The stages of a run as a table: what each reads, owns and depends on.

The work itself is in the packages; here is only how the run's config and folder map onto their arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from geoprior.config import RunConfig
    from geoprior.hooks.manager import Plugins
    from geoprior.hooks.types import Executor
    from geoprior.sim.config import SameEnvironmentConfig
    from geoprior.training.judge import JudgeMaker

SYNTHETIC = "shards/synthetic"
DEMOS = "shards/demos"
CHECKPOINTS = "checkpoints"
PRETRAIN = f"{CHECKPOINTS}/pretrain"
FINETUNE = f"{CHECKPOINTS}/finetune"
ROLLOUTS = "rollouts.jsonl"
FILMS = "films"
RESULTS = "results.json"
REPORT = "report"
_EPISODES = ("*.tar", "manifest.json")
_WEIGHTS = ("epoch-*",)


@dataclass(frozen=True)
class Workplace:
    """Where a stage works.

    Attributes:
        path: The run folder.
        plugins: Where names are looked up.
    """

    path: Path
    plugins: Plugins

    def executor(self, config: RunConfig) -> Executor:
        """The executor that the config names."""
        executor: Executor = self.plugins.build("executor", config.executor)
        return executor


def _never(_: RunConfig) -> bool:
    return False


def _always(_: RunConfig) -> bool:
    return True


def _nothing(_: RunConfig) -> Mapping[str, str]:
    return {}


@dataclass(frozen=True)
class Stage:
    """One stage.

    Attributes:
        name: Also the name of its command.
        summary: One line for ``--help``.
        inputs: Names of the stages that it reads.
        outputs: Files and folders of the run folder that it alone writes.
        config: The part of the config that its outputs depend on.
        run: Does the work; returns small facts for the run's record.
        revision: Raised when the same config and inputs come to mean something else.
        together: Whether all processes of torchrun take part in it; the others are the first one's alone.
        passes_on: Patterns of the names of the files that later stages read: those are made again when they
            are lost. The rest, such as logs, is for people.
        simulates: Whether it renders robots, for which a machine needs GL.
        outside: Digests of what it reads from outside of the run folder, each by a name: wherever that lies,
            other content is another input.
    """

    name: str
    summary: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    config: Callable[[RunConfig], dict[str, Any]]
    run: Callable[[RunConfig, Workplace], Mapping[str, Any]]
    revision: int = 1
    together: bool = False
    passes_on: tuple[str, ...] = ("*",)
    simulates: Callable[[RunConfig], bool] = _never
    outside: Callable[[RunConfig], Mapping[str, str]] = _nothing


def _part(*keys: str) -> Callable[[RunConfig], dict[str, Any]]:
    """What these keys say, as far as it decides a result."""

    def part(config: RunConfig) -> dict[str, Any]:
        from geoprior.options import Options, deciding

        tree = config.model_dump(mode="json", include=set(keys))
        sections = {key: getattr(config, key) for key in keys}
        return tree | {key: deciding(each) for key, each in sections.items() if isinstance(each, Options)}

    return part


def _pretrain_part(config: RunConfig) -> dict[str, Any]:
    from geoprior.hooks.manager import plugins
    from geoprior.options import deciding

    tree = _part("seed", "cameras", "generate", "policy", "pretrain")(config)
    source = config.pretrain.source
    options = deciding(plugins().options("source", source))
    tree["pretrain"]["source"] = {"name": source.name, **options}
    if config.pretrain.until_vision_gain is not None:
        tree["pretrain"]["probe_episodes"] = config.pretrain.probe_episodes
    if config.finetune.wants_blind_prior:
        tree["blind_prior"] = True
    return tree


def _finetune_part(config: RunConfig) -> dict[str, Any]:
    """A prior's path decides nothing, its content does: see `_outside_priors`."""
    tree = _part("seed", "policy", "finetune")(config)
    for name, condition in config.finetune.conditions.items():
        if condition.prior is not None:
            tree["finetune"]["conditions"][name]["prior"] = "of another run"
    return tree


def _outside_priors(config: RunConfig) -> Mapping[str, str]:
    conditions = config.finetune.conditions
    if all(condition.prior is None for condition in conditions.values()):
        return {}
    from geoprior.training.priors import outside_digests

    return {f"prior of {name}": digest for name, digest in outside_digests(conditions).items()}


def _generate(config: RunConfig, place: Workplace) -> Mapping[str, Any]:
    from geoprior.synthesis.generate import generate

    if config.same_environment is not None:
        return _collect_mixture(config.same_environment, config, place)
    manifest = generate(
        config.generate,
        config.cameras,
        seed=config.seed,
        executor=place.executor(config),
        out=place.path / SYNTHETIC,
    )
    return {"episodes": manifest.episodes}


def _collect_mixture(wanted: SameEnvironmentConfig, config: RunConfig, place: Workplace) -> Mapping[str, Any]:
    from geoprior.sim.mixture import collect_mixture

    manifest = collect_mixture(
        wanted,
        cameras=config.cameras,
        seed=config.seed,
        executor=place.executor(config),
        out=place.path / SYNTHETIC,
    )
    return {"episodes": manifest.episodes}


def _pretrain(config: RunConfig, place: Workplace) -> Mapping[str, Any]:
    from geoprior.probe.sight import REMEDY, from_metrics, warning
    from geoprior.progress import say
    from geoprior.training.stages import pretrain
    from geoprior.training.team import team

    result = pretrain(
        config.pretrain,
        policy=config.policy,
        seed=config.seed,
        data=place.path / SYNTHETIC,
        generate=config.generate,
        cameras=config.cameras,
        out=place.path / PRETRAIN,
        judge=_vision_judge(config),
        blind=config.finetune.wants_blind_prior,
        executor=place.executor(config),
    )
    blind = warning(from_metrics(result["metrics"]))
    if not blind:
        return result
    if team().leads:
        say(f"warning: {blind}\n  hint: {REMEDY}")
    return {**result, "warning": blind}


def _vision_judge(config: RunConfig) -> JudgeMaker | None:
    """What says at every checkpoint whether the prior looks, where fresh episodes can be made."""
    count = config.pretrain.probe_episodes
    if count == 0 or not config.has_recipe:
        return None
    from geoprior.probe.judge import make_vision_judge

    return partial(make_vision_judge, config.generate, config.cameras, config.seed, count)


def _demos(config: RunConfig, place: Workplace) -> Mapping[str, Any]:
    from geoprior.sim.demos import collect

    manifest = collect(
        config.demos,
        robot=config.robot,
        task=config.task,
        cameras=config.cameras,
        seed=config.seed,
        executor=place.executor(config),
        out=place.path / DEMOS,
    )
    return {"episodes": manifest.episodes}


def _finetune(config: RunConfig, place: Workplace) -> Mapping[str, Any]:
    from geoprior.training.stages import finetune

    return finetune(
        config.finetune,
        policy=config.policy,
        seed=config.seed,
        demos=place.path / DEMOS,
        prior=place.path / PRETRAIN,
        out=place.path / FINETUNE,
        executor=place.executor(config),
    )


def _evaluate(config: RunConfig, place: Workplace) -> Mapping[str, Any]:
    from geoprior.sim.rollout import evaluate, find_checkpoints

    return evaluate(
        config.evaluate,
        robot=config.robot,
        task=config.task,
        cameras=config.cameras,
        seed=config.seed,
        checkpoints=find_checkpoints(place.path / FINETUNE),
        executor=place.executor(config),
        out=place.path,
    )


def _report(config: RunConfig, place: Workplace) -> Mapping[str, Any]:
    from geoprior.report.run_report import report_run

    return report_run(
        seed=config.seed,
        synthetic=place.path / SYNTHETIC,
        demos=place.path / DEMOS,
        checkpoints=place.path / CHECKPOINTS,
        run=place.path,
        results=place.path / RESULTS,
        out=place.path / REPORT,
        conditions=config.finetune.conditions,
    )


STAGES = (
    Stage(
        name="generate",
        summary="Generate the geometric data set (or what stands in for it) into WebDataset shards.",
        inputs=(),
        outputs=(SYNTHETIC,),
        config=_part("seed", "cameras", "generate", "same_environment"),
        run=_generate,
        revision=2,
        passes_on=_EPISODES,
        simulates=lambda config: config.same_environment is not None,
    ),
    Stage(
        name="pretrain",
        summary="Train the policy on the geometric data set: this gives the prior.",
        inputs=("generate",),
        outputs=(PRETRAIN,),
        config=_pretrain_part,
        run=_pretrain,
        revision=2,
        together=True,
        passes_on=_WEIGHTS,
    ),
    Stage(
        name="demos",
        summary="Collect scripted demonstrations of the task on the robot.",
        inputs=(),
        outputs=(DEMOS,),
        config=_part("seed", "cameras", "robot", "task", "demos"),
        run=_demos,
        revision=2,
        passes_on=_EPISODES,
        simulates=_always,
    ),
    Stage(
        name="finetune",
        summary="Train on the demonstrations, once for each condition and training seed.",
        inputs=("pretrain", "demos"),
        outputs=(FINETUNE,),
        config=_finetune_part,
        run=_finetune,
        revision=3,
        together=True,
        passes_on=_WEIGHTS,
        outside=_outside_priors,
    ),
    Stage(
        name="evaluate",
        summary="Roll every checkpoint out on the same unseen initial states.",
        inputs=("finetune",),
        outputs=(ROLLOUTS, FILMS),
        config=_part("seed", "cameras", "robot", "task", "evaluate"),
        run=_evaluate,
        simulates=_always,
    ),
    Stage(
        name="report",
        summary="Write report/index.html and results.json.",
        inputs=("generate", "pretrain", "demos", "finetune", "evaluate"),
        outputs=(RESULTS, REPORT),
        config=_part("seed"),
        run=_report,
    ),
)
STAGE_NAMES = tuple(stage.name for stage in STAGES)
