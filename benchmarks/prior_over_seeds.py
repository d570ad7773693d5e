"""What the quickstart's prior is worth over several training seeds: success rates, differences, intervals.

    python benchmarks/prior_over_seeds.py --out runs/seeds --json benchmarks/results/prior_over_seeds.json

Runs ``geoprior run benchmarks/prior_over_seeds.yaml``, which goes on where it was stopped (some 40 minutes on
2 cores), and tells what stands in its ``results.json``. One prior, five trainings from it and five from
scratch, each rolled out from the same initial states. Time is not measured, so other work does no harm.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from geoprior.bench.metrics import Metric, as_lines, report
from geoprior.files import read_json, write_json
from geoprior.study.schema import Bounds, Comparison, ConditionResult, parse_results

CONFIG = Path(__file__).with_suffix(".yaml")


def rates_of(condition: ConditionResult) -> Iterator[Metric]:
    """Successes at every checkpoint, in all and by training seed."""
    for checkpoint in condition.checkpoints:
        name = f"{condition.name}, {checkpoint.epoch} epochs"
        yield from _with_bounds(f"{name}: success", checkpoint.rate, checkpoint.interval, "%")
        for seed, successes in checkpoint.successes_by_training_seed.items():
            yield Metric(f"{name}: successes of training seed {seed}", successes, "rollouts")


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


def main() -> None:
    """Run, print, and write the JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="the run folder; gone on with if it is there")
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    options = parser.parse_args()
    command = [sys.executable, "-m", "geoprior", "run", str(CONFIG), "--out", str(options.out)]
    done = subprocess.run(command, check=False)
    if done.returncode:
        sys.exit(done.returncode)
    outcome = read_json(options.out / "results.json")
    metrics: list[Metric] = []
    for group in parse_results(outcome).groups:
        metrics += [metric for condition in group.conditions for metric in rates_of(condition)]
        metrics += [metric for comparison in group.comparisons for metric in differences_of(comparison)]
    content = report("prior_over_seeds", "python benchmarks/prior_over_seeds.py --out runs/seeds", metrics)
    content["outcome"] = outcome
    print("\n".join(as_lines(content)))
    if options.json:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
