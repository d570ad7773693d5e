"""Do the cheap measures of a prior rank as rollouts do? Rank correlations with success, over checkpoints.

    python -m benchmarks prior_measures --run runs/a --run runs/b --out runs/measures
    python -m benchmarks prior_measures --plan plan.yaml --out runs/measures

Two kinds of checkpoints are measured. A *prior* is one of pretraining from which fine-tunings began; its
success is the share of successful trials of all checkpoints of those fine-tunings, one robot and task at a
time. A *policy* is a fine-tuned checkpoint that was rolled out; its success is its own. Which prior a
fine-tuning began from stands in its checkpoints.

``--run`` names a run folder of `geoprior run`. ``--plan`` is a YAML file for folders that lie elsewhere:

    priors:      # folders with epoch-*.safetensors, and the config that they were pretrained with
      - {folder: runs/prior/priors/sighted-11, config: benchmarks/prior/sighted.yaml, set: [seed=11]}
    trainings:   # folders of fine-tunings CONDITION-sSEED, their rollouts, and the config of both
      - {folder: runs/prior/pick-11/trainings, rollouts: runs/prior/pick-11/rollouts.jsonl,
         config: benchmarks/prior/trial.yaml}

What is measured is kept in ``--out``, so that the same command goes on where it was stopped; a checkpoint
takes some seconds. Spearman's rank correlation is told for each robot and task, with the number of
checkpoints, and over all of them with ranks taken within each robot and task.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.stats import rankdata

from benchmarks.metrics import Metric, as_lines, report
from geoprior.config import RunConfig, load_config
from geoprior.errors import ConfigError
from geoprior.files import sha256_json, write_bytes, write_json
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.checkpoint import list_checkpoints, read_header, weights_digest
from geoprior.probe.aim import FIRST_STATE, aim_error, see_resets
from geoprior.probe.checkpoint import Measures, load_trained
from geoprior.probe.linear import probe_resets
from geoprior.probe.sight import ALL
from geoprior.probing import Wanted, probe_checkpoint
from geoprior.progress import track
from geoprior.sim.rollout import DIGITS, CheckpointRef, find_checkpoints
from geoprior.sim.workers import Setup
from geoprior.study.results import read_rollouts

EPISODES, STATES = 100, 160
Began = tuple[str, int]
"""Fingerprint of a prior's training, and the epoch of its checkpoint."""
FEWEST = 4
"""Checkpoints of a robot and task from which a rank correlation is told."""


@dataclass(frozen=True)
class Priors:
    """A folder of pretraining's checkpoints and their config."""

    folder: Path
    config: RunConfig


@dataclass(frozen=True)
class Trainings:
    """A folder of fine-tunings, their rollouts and their config."""

    folder: Path
    rollouts: Path
    config: RunConfig


@dataclass(frozen=True)
class Unit:
    """One checkpoint in one robot's task.

    Attributes:
        kind: ``prior`` or ``policy``.
        path: Of its weights.
        robot: Registered name.
        task: Registered name.
        config: What it is measured with.
        outcomes: Of all trials that count for it.
    """

    kind: str
    path: Path
    robot: str
    task: str
    config: RunConfig
    outcomes: Sequence[bool]

    @property
    def key(self) -> str:
        """What the measurement depends on."""
        return sha256_json([self.kind, weights_digest(self.path), self.robot, self.task, EPISODES, STATES])


def read_plan(runs: Sequence[Path], plan: Path | None) -> tuple[list[Priors], list[Trainings]]:
    """What there is to measure.

    Raises:
        ConfigError: The plan is not what this module's docstring says.
    """
    priors, trainings = [], []
    for run in runs:
        config = load_config(run / "config.yaml", (), plugins())
        priors.append(Priors(run / "checkpoints" / "pretrain", config))
        trainings.append(Trainings(run / "checkpoints" / "finetune", run / "rollouts.jsonl", config))
    if plan is None:
        return priors, trainings
    try:
        tree = yaml.safe_load(plan.read_text(encoding="utf-8"))
        for one in tree["priors"]:
            config = load_config(one["config"], tuple(one.get("set", ())), plugins())
            priors.append(Priors(Path(one["folder"]), config))
        for one in tree["trainings"]:
            config = load_config(one["config"], tuple(one.get("set", ())), plugins())
            trainings.append(Trainings(Path(one["folder"]), Path(one["rollouts"]), config))
    except (OSError, KeyError, TypeError, yaml.YAMLError) as error:
        raise ConfigError(
            f"{plan}: not a plan ({type(error).__name__}: {error})", "see the docstring of this script"
        ) from error
    return priors, trainings


def units_of(priors: Sequence[Priors], trainings: Sequence[Trainings]) -> list[Unit]:
    """The policies that were rolled out, and the priors that they began from."""
    policies = [unit for each in trainings for unit in rolled_out(each)]
    gathered: dict[tuple[Began, str, str], list[bool]] = defaultdict(list)
    for unit in policies:
        if (began := prior_of(unit.path)) is not None:
            gathered[began, unit.robot, unit.task] += unit.outcomes
    known = {
        (sha256_json(header.details), header.epoch): (checkpoint.path, one.config)
        for one in priors
        for checkpoint in list_checkpoints(one.folder)
        for header in [read_header(checkpoint.path)]
    }
    return policies + [
        Unit("prior", known[began][0], robot, task, known[began][1], successes)
        for (began, robot, task), successes in gathered.items()
        if began in known
    ]


def rolled_out(trainings: Trainings) -> Iterator[Unit]:
    """The policies of some trainings that there are rollouts of."""
    refs = {ref.weights: ref for ref in find_checkpoints(trainings.folder)}
    outcomes: dict[tuple[CheckpointRef, str, str], list[bool]] = defaultdict(list)
    for record in read_rollouts(trainings.rollouts):
        if record.weights[:DIGITS] in refs:
            outcomes[refs[record.weights[:DIGITS]], record.robot, record.task].append(record.success)
    for (ref, robot, task), successes in outcomes.items():
        yield Unit("policy", ref.path, robot, task, trainings.config, successes)


def prior_of(checkpoint: Path) -> Began | None:
    """The prior that a fine-tuning took weights from, as its checkpoint names it."""
    transfer: Any = read_header(checkpoint).details.get("transfer", {})
    return (transfer["prior"]["fingerprint"], transfer["prior"]["epoch"]) if "weights" in transfer else None


def measure(unit: Unit) -> dict[str, float]:
    """Every cheap measure of it, by name."""
    if unit.kind == "prior":
        wanted = Wanted(
            episodes=EPISODES,
            states=STATES,
            robot=Choice(name=unit.robot),
            task=Choice(name=unit.task),
            config=unit.config,
        )
        return _of_prior(probe_checkpoint(unit.path, wanted), unit.task)
    trained = load_trained(unit.path)
    setup = Setup(Choice(name=unit.robot), Choice(name=unit.task), unit.config.cameras)
    states = range(FIRST_STATE, FIRST_STATE + STATES)
    resets = see_resets(setup, unit.config.demos.control_rate, states, trained.header.features)
    if resets is None:
        return {}
    linear = probe_resets(trained.policy, resets, trained.header.features) or {}
    return _aims(aim_error(trained.predictor, resets)) | _linear(linear)


def _of_prior(found: Measures, task: str) -> dict[str, float]:
    measured = {}
    for name, motion in (("all motions", ALL), ("its motion", task)):
        if motion in found.motions:
            sight = found.motions[motion]
            measured |= {
                f"vision gain, {name}": sight.vision_gain,
                f"vision gain of the shuffled L1, {name}": sight.vision_gain / sight.shuffled,
                f"L1, {name}": sight.true,
                f"L1 of the better baseline's, {name}": sight.true / sight.baseline[1],
            }
    return measured | _aims(found.aim or {}) | _linear(found.linear_probe_cm or {})


def _aims(aim: Mapping[str, float]) -> dict[str, float]:
    named = {f"aim error, {name.removesuffix('_cm').replace('_', ' ')}": value for name, value in aim.items()}
    if aim:
        named["aim error, shuffled less true"] = aim["shuffled_cm"] - aim["true_cm"]
        named["aim error, nearest: shuffled less true"] = aim["nearest_shuffled_cm"] - aim["nearest_cm"]
    return named


def _linear(found: Mapping[str, float]) -> dict[str, float]:
    return {f"linear probe, {camera}": value for camera, value in found.items()}


def measured_units(units: Sequence[Unit], out: Path) -> list[dict[str, Any]]:
    """A row for each, from the folder where it is there already."""
    rows = []
    with track("measures", len(units), "checkpoints") as progress:
        for unit in units:
            path = out / f"{unit.key}.json"
            if not path.exists():
                write_bytes(path, json.dumps(measure(unit)).encode())
            rows.append(
                {
                    "kind": unit.kind,
                    "checkpoint": str(unit.path),
                    "robot": unit.robot,
                    "task": unit.task,
                    "success": float(np.mean(unit.outcomes)),
                    "trials": len(unit.outcomes),
                    "measures": json.loads(path.read_text(encoding="utf-8")),
                }
            )
            progress.advance()
    return rows


def correlations(rows: Sequence[Mapping[str, Any]]) -> Iterator[Metric]:
    """Spearman's, by kind and measure: of every robot and task, and with ranks within them over all."""
    for kind in ("prior", "policy"):
        ours = [row for row in rows if row["kind"] == kind]
        for name in sorted({name for row in ours for name in row["measures"]}):
            groups: dict[str, list[tuple[float, float]]] = defaultdict(list)
            for row in ours:
                if name in row["measures"]:
                    groups[f"{row['robot']} {row['task']}"].append((row["measures"][name], row["success"]))
            pooled = []
            for where, pairs in sorted(groups.items()):
                ranks = _ranks(pairs)
                pooled.append(ranks)
                yield from _told(f"{kind}: {name}, {where}", ranks)
            if len(groups) > 1:
                yield from _told(f"{kind}: {name}, over all", np.concatenate(pooled))


def _ranks(pairs: Sequence[tuple[float, float]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(n, 2) ranks, their mean 0 and from -0.5 to 0.5 whatever n."""
    ranked = np.column_stack([rankdata(column) for column in zip(*pairs, strict=True)])
    return (ranked - (len(pairs) + 1) / 2.0) / max(len(pairs) - 1, 1)


def _told(name: str, ranks: np.ndarray[Any, np.dtype[np.float64]]) -> Iterator[Metric]:
    spread = ranks.std(axis=0)
    if len(ranks) < FEWEST or spread.min() == 0.0:
        return
    yield Metric(name, float(np.mean(ranks[:, 0] * ranks[:, 1]) / spread.prod()), "rank correlation")
    yield Metric(f"{name}: of", len(ranks), "checkpoints")


def main() -> None:
    """Measure, print, and write the JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--run", type=Path, action="append", default=[], help="a run folder; may be repeated")
    parser.add_argument("--plan", type=Path, help="YAML of folders that lie elsewhere; see above")
    parser.add_argument(
        "--out", type=Path, required=True, help="keeps what was measured; gone on with if there"
    )
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    options = parser.parse_args()
    units = units_of(*read_plan(options.run, options.plan))
    if not units:
        raise ConfigError("nothing that was rolled out is in these folders", "give --run or --plan")
    rows = measured_units(units, options.out)
    command = "python -m benchmarks prior_measures --plan PLAN --out runs/measures"
    content = report("prior_measures", command, list(correlations(rows)))
    content["episodes"], content["states"] = EPISODES, STATES
    content["checkpoints"] = rows
    print("\n".join(as_lines(content)))
    if options.json:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
