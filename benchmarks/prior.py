"""What long priors are worth on three arms: success rates, paired differences, intervals, and the controls.

    python -m benchmarks prior --out runs/prior --json benchmarks/results/prior.json

For every root seed it trains the prior of each recipe (`benchmarks/prior/NAME.yaml`), probes it, collects 20
demonstrations of each task on its arm, fine-tunes on them from every beginning, and rolls the checkpoints out
on the same unseen initial states. Nothing was tuned on these root seeds, demonstrations or initial states.

All of it takes hours and goes on where it was stopped: ``--parts`` names what to do, ``--seeds`` for which
root seeds. Time is not measured, so other work does no harm.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.metrics import Metric, as_lines, at_least, at_most, report
from benchmarks.prior_factors import metrics_of as probes_of
from benchmarks.prior_factors import probe_on_arms
from geoprior.config import RunConfig, load_config
from geoprior.executors.local import LocalConfig, LocalExecutor, SerialExecutor
from geoprior.files import write_json
from geoprior.hooks.manager import plugins
from geoprior.policies.checkpoint import checkpoint_path
from geoprior.sim.demos import collect
from geoprior.sim.records import TrialRecord
from geoprior.sim.rollout import evaluate, find_checkpoints
from geoprior.study.results import GroupResult, Results, read_rollouts, summarise
from geoprior.synthesis.generate import generate
from geoprior.training.stages import finetune, pretrain

HERE = Path(__file__).with_suffix("")
SEEDS = (11, 12, 13, 14, 15)
RECIPES = ("sighted", "paper", "blind")
EPOCHS = (64, 128, 256, 384, 512)
"""Fixed in advance."""
TASKS = {"pick": ("ur5e", 8.0, 45.0), "place": ("xarm7", 12.0, 30.0), "push": ("kinova3", 10.0, 15.0)}
"""Arm, time limit in seconds, and the points of area by which the prior shall beat scratch."""
BEST = {"pick": 90.0, "place": 70.0, "push": 50.0}
"""Success at the best fixed checkpoint that the prior shall reach, in percent."""
GOALS_OF_SIGHT: dict[str, Callable[[str, float, str], Metric]] = {
    "vision gain on pick over its shuffled L1": partial(at_least, goal=0.6),
    "L1 over the better baseline's": partial(at_most, goal=0.55),
}
PARTS = ("priors", "probes", "trainings", "rollouts")


@dataclass(frozen=True)
class Prior:
    """One prior to train: a unit of work for a process of its own."""

    recipe: str
    seed: int
    out: Path


@dataclass(frozen=True)
class Trial:
    """One arm, task and root seed."""

    task: str
    seed: int
    out: Path

    @property
    def folder(self) -> Path:
        """Where its demonstrations, trainings and rollouts lie."""
        return self.out / f"{self.task}-{self.seed}"


def prior_folder(out: Path, recipe: str, seed: int) -> Path:
    """Where a prior's checkpoints lie."""
    return out / "priors" / f"{recipe}-{seed}"


def config_of_prior(prior: Prior) -> RunConfig:
    """What a prior is trained as."""
    overrides = (f"seed={prior.seed}", "pretrain.threads=1")
    return load_config(HERE / f"{prior.recipe}.yaml", overrides, plugins())


def make_prior(prior: Prior) -> None:
    """Train one prior, or go on with it."""
    config = config_of_prior(prior)
    shards = prior.out / "shards" / f"{prior.recipe}-{prior.seed}"
    if config.pretrain.source.name == "shards":
        generate(config.generate, config.cameras, seed=prior.seed, executor=SerialExecutor(), out=shards)
    pretrain(
        config.pretrain,
        policy=config.policy,
        seed=prior.seed,
        data=shards,
        generate=config.generate,
        cameras=config.cameras,
        out=prior_folder(prior.out, prior.recipe, prior.seed),
        executor=SerialExecutor(),
    )


def probe_prior(prior: Prior) -> dict[str, Any]:
    """Measure a prior without fine-tuning, once."""
    return probe_on_arms(prior_folder(prior.out, prior.recipe, prior.seed), config_of_prior(prior))


def config_of(trial: Trial) -> RunConfig:
    """Demonstrations, trainings and rollouts of one arm, task and root seed."""
    robot, limit, _ = TASKS[trial.task]
    priors = {recipe: str(prior_folder(trial.out, recipe, trial.seed).absolute()) for recipe in RECIPES}
    beginnings = {
        "scratch": "{init: scratch}",
        "statistics": f"{{init: scratch, statistics: pretrained, prior: {priors['sighted']}}}",
    }
    beginnings |= {
        recipe: f"{{init: prior, statistics: pretrained, prior: {path}}}"
        for recipe, path in priors.items()
        if Path(path).exists()
    }
    conditions = ", ".join(f"{name}: {how}" for name, how in beginnings.items())
    overrides = (
        f"seed={trial.seed}",
        f"robot={robot}",
        f"task={trial.task}",
        f"evaluate.time_limit={limit}",
        f"demos.first_state={100_000 + 1_000 * trial.seed}",
        f"finetune.conditions={{{conditions}}}",
    )
    return load_config(HERE / "trial.yaml", overrides, plugins())


def fine_tune(trial: Trial, executor: LocalExecutor) -> None:
    """Collect the demonstrations and train on them from every beginning, or go on with it."""
    config, demos = config_of(trial), trial.folder / "demos"
    collect(
        config.demos,
        robot=config.robot,
        task=config.task,
        cameras=config.cameras,
        seed=config.seed,
        executor=executor,
        out=demos,
    )
    finetune(
        config.finetune,
        policy=config.policy,
        seed=config.seed,
        demos=demos,
        prior=None,
        out=trial.folder / "trainings",
        executor=executor,
    )


def roll_out(trial: Trial, executor: LocalExecutor) -> None:
    """Roll the checkpoints of all trainings out, or go on with it."""
    config = config_of(trial)
    found = find_checkpoints(trial.folder / "trainings")
    evaluate(
        config.evaluate,
        robot=config.robot,
        task=config.task,
        cameras=config.cameras,
        seed=config.seed,
        checkpoints=[checkpoint for checkpoint in found if checkpoint.epoch in EPOCHS],
        executor=executor,
        out=trial.folder,
    )


def together(out: Path, task: str, seeds: Sequence[int]) -> Results:
    """All root seeds of one task as one study, in which a root seed is what a training seed is in a run."""
    trials: list[TrialRecord] = []
    for seed in seeds:
        records = read_rollouts(Trial(task, seed, out).folder / "rollouts.jsonl")
        trials += [replace(record, training_seed=seed) for record in records]
    return summarise(trials, seed=SEEDS[0])


def metrics_of(task: str, group: GroupResult) -> Iterator[Metric]:
    """Areas, differences to scratch with intervals, best and last checkpoints."""
    robot, _, goal = TASKS[task]
    where = f"{robot} {task}"
    for condition in group.conditions:
        name = f"{where}, {condition.name}"
        yield Metric(f"{name}: area", 100.0 * condition.area_under_curve, "%")
        best = 100.0 * condition.peak.rate
        if condition.name == "sighted":
            yield at_least(f"{name}: best checkpoint (a peak)", best, "%", BEST[task])
        else:
            yield Metric(f"{name}: best checkpoint (a peak)", best, "%")
        yield Metric(f"{name}: last checkpoint", 100.0 * condition.last_checkpoint.rate, "%")
    for comparison in group.comparisons:
        name, area = f"{where}, {comparison.condition} less scratch", comparison.area_under_curve
        points, low = 100.0 * area.difference, 100.0 * area.interval.low
        if comparison.condition == "sighted":
            yield at_least(f"{name}: area", points, "points", goal)
            yield at_least(f"{name}: area, from", low, "points", 0.0)
        else:
            yield Metric(f"{name}: area", points, "points")
            yield Metric(f"{name}: area, from", low, "points")
        yield Metric(f"{name}: area, to", 100.0 * area.interval.high, "points")
        last = comparison.checkpoints[-1]
        yield Metric(f"{name}: last checkpoint", 100.0 * last.difference, "points")
        yield Metric(f"{name}: last checkpoint, from", 100.0 * last.interval.low, "points")
        yield Metric(f"{name}: last checkpoint, to", 100.0 * last.interval.high, "points")


def main() -> None:
    """Do the parts asked for, then tell what all rollouts so far say."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of it all; gone on with if there")
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    parser.add_argument("--parts", nargs="*", choices=PARTS, default=PARTS)
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--recipes", nargs="+", choices=RECIPES, default=list(RECIPES))
    options = parser.parse_args()
    executor = LocalExecutor(LocalConfig())
    if "priors" in options.parts:
        wanted = [Prior(recipe, seed, options.out) for seed in options.seeds for recipe in options.recipes]
        for _ in executor.run(make_prior, wanted):
            pass
    if "probes" in options.parts:
        for _ in executor.run(probe_prior, finished_priors(options.out, options.recipes, options.seeds)):
            pass
    trials = [Trial(task, seed, options.out) for seed in options.seeds for task in options.tasks]
    for trial in trials:
        if "trainings" in options.parts:
            fine_tune(trial, executor)
        if "rollouts" in options.parts:
            roll_out(trial, executor)
    tell(options.out, options.tasks, options.seeds, options.json)


def finished_priors(out: Path, recipes: Sequence[str], seeds: Sequence[int]) -> list[Prior]:
    """Those whose training has come to its end."""
    priors = [Prior(recipe, seed, out) for recipe in recipes for seed in seeds]
    return [prior for prior in priors if is_finished(prior)]


def is_finished(prior: Prior) -> bool:
    """Whether the last checkpoint that the config wants is there."""
    folder, config = prior_folder(prior.out, prior.recipe, prior.seed), config_of_prior(prior)
    return checkpoint_path(folder, config.pretrain.epochs).exists()


def sight_of(name: str, found: dict[str, Any]) -> Iterator[Metric]:
    """A prior's cheap measures; those of the recipe `sighted` have goals."""
    for metric in probes_of(name, found):
        goal = GOALS_OF_SIGHT.get(metric.metric.partition(": ")[2])
        if goal is None or not name.startswith("sighted"):
            yield metric
        else:
            yield goal(metric.metric, metric.value, metric.unit)


def what_is_left(found: Mapping[str, Results], seeds: Sequence[int]) -> str:
    """What of the study these results do not have, for whoever reads them; empty where it is whole."""
    have = {each.name for results in found.values() for each in results.groups[0].conditions}
    left = [
        ("root seeds", [str(seed) for seed in SEEDS if seed not in seeds]),
        ("tasks", [task for task in TASKS if task not in found]),
        ("recipes", [recipe for recipe in RECIPES if recipe not in have]),
    ]
    told = [f"{what} {', '.join(names)}" for what, names in left if names]
    return f"Not run: {'; '.join(told)}." if told else ""


def tell(out: Path, tasks: Sequence[str], seeds: Sequence[int], json: Path | None) -> None:
    """Print what the rollouts say, and write the JSON."""
    probed = {
        f"{prior.recipe}, seed {prior.seed}": probe_prior(prior)
        for prior in finished_priors(out, RECIPES, seeds)
    }
    found = {task: together(out, task, seeds) for task in tasks}
    metrics = [metric for name, measured in probed.items() for metric in sight_of(name, measured)]
    metrics += [metric for task, results in found.items() for metric in metrics_of(task, results.groups[0])]
    content = report("prior", "python -m benchmarks prior --out runs/prior", metrics)
    if left := what_is_left(found, seeds):
        content["note"] = left
    content["root_seeds"] = list(seeds)
    content["measures"] = probed
    content["outcome"] = {task: results.model_dump(mode="json") for task, results in found.items()}
    print("\n".join(as_lines(content)))
    if json:
        write_json(json, content)


if __name__ == "__main__":
    main()
