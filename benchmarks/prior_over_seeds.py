"""What the quickstart's prior is worth over several root seeds: success rates, differences, intervals.

    python -m benchmarks prior_over_seeds --out runs/seeds --json benchmarks/results/prior_over_seeds.json

Runs ``geoprior run benchmarks/prior_over_seeds.yaml`` once for each root seed, which goes on where it was
stopped (twenty minutes on 2 cores in all), and tells what follows from all rollouts together. As many runs as
there are cores go side by side, each on one thread. A root seed
decides the geometric episodes, the prior, the expert's variation in the demonstrations and both trainings;
the initial states are the same for all. Time is not measured, so other work does no harm.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from benchmarks.metrics import Metric, as_lines, at_least, report
from geoprior.files import write_json
from geoprior.study.results import Results, read_rollouts, summarise
from geoprior.study.schema import Bounds, Comparison, ConditionResult

CONFIG = Path(__file__).with_suffix(".yaml")
ROOT_SEEDS = (1, 2, 3, 4, 5)
"""The quickstart's own first; none is the tuning's."""
OWN_TRIALS = 20
"""Initial states that `make run` rolls out: the first ones."""


def rates_of(condition: ConditionResult) -> Iterator[Metric]:
    """Successes at every checkpoint, in all and by root seed."""
    for checkpoint in condition.checkpoints:
        name = f"{condition.name}, {checkpoint.epoch} epochs"
        yield from _with_bounds(f"{name}: success", checkpoint.rate, checkpoint.interval, "%")
        for seed, successes in checkpoint.successes_by_training_seed.items():
            yield Metric(f"{name}: successes of root seed {seed}", successes, "rollouts")


def differences_of(comparison: Comparison) -> Iterator[Metric]:
    """Condition minus baseline at every checkpoint, and over the curve."""
    name = f"{comparison.condition} less {comparison.baseline}"
    for checkpoint in comparison.checkpoints:
        label = f"{name}, {checkpoint.epoch} epochs"
        yield from _with_bounds(label, checkpoint.difference, checkpoint.interval, "points")
    area = comparison.area_under_curve
    yield from _with_bounds(f"{name}, area under the curve", area.difference, area.interval, "points")


def _with_bounds(name: str, value: float, bounds: Bounds, unit: str) -> Iterator[Metric]:
    for label, share in ((name, value), (f"{name}: from", bounds.low), (f"{name}: to", bounds.high)):
        yield Metric(label, 100.0 * share, unit)


def clear_runs(out: Path) -> Metric:
    """In how many runs the quickstart's own trials show a difference whose interval is above zero."""
    clear = 0
    for seed in ROOT_SEEDS:
        trials = read_rollouts(out / f"seed-{seed}" / "rollouts.jsonl")
        states = sorted({trial.state_seed for trial in trials})[:OWN_TRIALS]
        found = summarise([trial for trial in trials if trial.state_seed in states], seed=seed)
        (comparison,) = found.groups[0].comparisons
        clear += comparison.area_under_curve.interval.low > 0.0
    name = f"runs of {len(ROOT_SEEDS)} whose own {OWN_TRIALS} states show a clear difference"
    return at_least(name, clear, "runs", len(ROOT_SEEDS) - 1)


def run(seed: int, out: Path) -> None:
    """One run from its geometric episodes to its rollouts, or what is missing of it."""
    words = ["geoprior", "run", str(CONFIG), "--out", str(out)]
    settings = ("--set", f"seed={seed}", "--set", "executor=serial")
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    subprocess.run([sys.executable, "-m", *words, *settings], check=True, env=environment)


def together(out: Path) -> Results:
    """All runs as one study, in which a root seed is what a training seed is within a run."""
    trials = [
        replace(trial, training_seed=seed)
        for seed in ROOT_SEEDS
        for trial in read_rollouts(out / f"seed-{seed}" / "rollouts.jsonl")
    ]
    return summarise(trials, seed=ROOT_SEEDS[0])


def main() -> None:
    """Run, print, and write the JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs; gone on with if there")
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    options = parser.parse_args()
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        list(pool.map(run, ROOT_SEEDS, [options.out / f"seed-{seed}" for seed in ROOT_SEEDS]))
    found = together(options.out)
    metrics = [clear_runs(options.out)]
    for group in found.groups:
        metrics += [metric for condition in group.conditions for metric in rates_of(condition)]
        metrics += [metric for comparison in group.comparisons for metric in differences_of(comparison)]
    content = report("prior_over_seeds", "python -m benchmarks prior_over_seeds --out runs/seeds", metrics)
    content["outcome"] = found.model_dump(mode="json")
    print("\n".join(as_lines(content)))
    if options.json:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
