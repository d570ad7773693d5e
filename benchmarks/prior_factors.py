"""What each part of the recipe `sighted` does for a prior: cheap measures, one factor at a time and together.

    python -m benchmarks prior_factors --out runs/factors --json benchmarks/results/prior_factors.json

Every prior has the quickstart's network and 21,600 samples. The vision gain is that on fresh episodes of the
prior's own data, and so cannot be compared between data that differ much; the aim error can: it is taken
without any fine-tuning, on unseen initial states of three arms and tasks. Tuning seeds; goes on where it was
stopped.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.metrics import Metric, as_lines, report
from geoprior.config import RunConfig, load_config
from geoprior.executors.local import LocalConfig, LocalExecutor, SerialExecutor
from geoprior.files import write_json
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.checkpoint import list_checkpoints
from geoprior.probing import Wanted, probe_checkpoint
from geoprior.training.stages import pretrain

SEED = 100
EPISODES, STATES = 60, 160
PLACES = {"pick": "ur5e", "place": "xarm7", "push": "kinova3"}
LEARNING = (
    f"seed={SEED}",
    "generate.targets=true",
    "policy.target_weight=2.0",
    "pretrain.source={name: endless, episodes: 200, keep: 8, workers: 0}",
    "pretrain.epochs=36",
    "pretrain.batch_size=16",
    "pretrain.learning_rate=6e-4",
    "pretrain.schedule=cosine",
    "pretrain.warmup_steps=200",
    "pretrain.threads=1",
    "pretrain.precision=bf16",
    "pretrain.probe_episodes=0",
)
HAND = "generate.scene.hand"
FACTORS: dict[str, tuple[str, tuple[str, ...]]] = {
    "sighted": ("sighted", ()),
    "paper": ("lite", ()),
    "paper, drawn as solids": ("lite", ("generate.renderer=solids",)),
    "sighted, drawn as points": ("sighted", ("generate.renderer=points",)),
    "sighted without its starts": (
        "sighted",
        (f"{HAND}.about=object", f"{HAND}.aim=0.05", f"{HAND}.down=0.0", f"{HAND}.offset=0.2"),
    ),
    "sighted without its speed": ("sighted", ("generate.seconds=[10, 10]",)),
    "sighted without its camera mounts": (
        "sighted",
        (f"{HAND}.camera_up=[0, 0]", f"{HAND}.camera_right=[0, 0]", f"{HAND}.camera_pitch=[0, 0]"),
    ),
    "sighted without fingers, arm and distractors": (
        "sighted",
        (f"{HAND}.fingers=null", "generate.scene.arm=null", "generate.scene.distractors=null"),
    ),
    "sighted without motions from above": (
        "sighted",
        tuple(f"generate.motions.{number}.from_above=null" for number in range(3)),
    ),
    "sighted without its markers": (
        "sighted",
        ("generate.scene.marker.size=[1, 1]", "generate.scene.marker.outline=0.0"),
    ),
    "sighted, constant learning rate": (
        "sighted",
        ("pretrain.schedule=constant", "pretrain.learning_rate=3e-4"),
    ),
    "sighted, more of the early time steps": ("sighted", ("pretrain.early=2",)),
    "sighted without targets": ("sighted", ("generate.targets=false", "policy.target_weight=0.0")),
    "sighted, positions relative to the hand": ("sighted", ("policy.actions=relative",)),
    "sighted, black images": ("sighted", ("generate.variants=[black-images]",)),
}
"""Packaged config and overrides of each prior."""


@dataclass(frozen=True)
class Factor:
    """One prior to train and to measure: a unit of work for a process of its own."""

    name: str
    out: Path

    @property
    def folder(self) -> Path:
        """Where its checkpoint lies."""
        return self.out / self.name.replace(",", "").replace(" ", "-")

    @property
    def config(self) -> RunConfig:
        """What it is trained as."""
        base, overrides = FACTORS[self.name]
        return load_config(base, (*LEARNING, *overrides), plugins())


def measure(factor: Factor) -> dict[str, Any]:
    """Train the prior and measure it, or what is missing of that."""
    config = factor.config
    pretrain(
        config.pretrain,
        policy=config.policy,
        seed=config.seed,
        data=factor.out / "no-shards",
        generate=config.generate,
        cameras=config.cameras,
        out=factor.folder,
        executor=SerialExecutor(),
    )
    return probe_on_arms(factor.folder, config)


def probe_on_arms(folder: Path, config: RunConfig) -> dict[str, Any]:
    """Measure the last checkpoint of a prior, once: on fresh episodes, and its aim on every arm and task.

    Args:
        folder: Of its checkpoints; what is found is kept there.
        config: What it was trained as.
    """
    done = folder / "measures.json"
    if done.exists():
        known: dict[str, Any] = json.loads(done.read_text())
        return known
    checkpoint = list_checkpoints(folder)[-1].path
    found: dict[str, Any] = {}
    for task, robot in PLACES.items():
        wanted = Wanted(
            episodes=EPISODES if not found else 2,
            states=STATES,
            robot=Choice(name=robot),
            task=Choice(name=task),
            config=config,
        )
        tree = probe_checkpoint(checkpoint, wanted).as_tree()
        found = found or tree | {"aims": {}}
        found["aims"][task] = tree["aim"]
    write_json(done, found)
    return found


def metrics_of(name: str, found: dict[str, Any]) -> Iterator[Metric]:
    """Vision gain, errors against baselines, aim errors."""
    everything, pick = found["motions"]["all"], found["motions"]["pick"]
    baseline = min(everything["still"], everything["pose_only"])
    yield Metric(f"{name}: vision gain", everything["vision_gain"], "normalised L1")
    yield Metric(f"{name}: its standard error", everything["vision_gain_se"], "normalised L1")
    yield Metric(
        f"{name}: vision gain on pick over its shuffled L1", pick["vision_gain"] / pick["shuffled"], ""
    )
    yield Metric(f"{name}: L1 over the better baseline's", everything["true"] / baseline, "")
    for task, aim in found["aims"].items():
        for key in ("true_cm", "shuffled_cm", "nearest_cm"):
            if aim is not None and key in aim:
                yield Metric(f"{name}: aim on {PLACES[task]} {task}, {key[:-3]}", aim[key], "cm")


def main() -> None:
    """Train and measure every prior, print, and write the JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the priors; gone on with if there")
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    parser.add_argument("--only", nargs="+", choices=FACTORS, default=list(FACTORS), metavar="NAME")
    options = parser.parse_args()
    factors = [Factor(name, options.out) for name in options.only]
    results: dict[str, dict[str, Any]] = {}
    for position, found in LocalExecutor(LocalConfig()).run(measure, factors):
        results[factors[position].name] = found
    metrics = [metric for name in options.only for metric in metrics_of(name, results[name])]
    content = report("prior_factors", "python -m benchmarks prior_factors --out runs/factors", metrics)
    if set(options.only) != set(FACTORS):
        left = ", ".join(name for name in FACTORS if name not in options.only)
        content["note"] = f"Known to the command and not measured: {left}."
    content["measures"] = {name: results[name] for name in options.only}
    print("\n".join(as_lines(content)))
    if options.json:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
