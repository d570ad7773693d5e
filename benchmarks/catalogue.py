"""The benchmarks by name, and how one is run."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from benchmarks.metrics import Metric, as_lines, report
from geoprior.config_tree import suggest
from geoprior.errors import ConfigError


@dataclass(frozen=True)
class Benchmark:
    """A benchmark.

    Attributes:
        summary: One line for ``--help``.
        module: Has ``measure() -> Iterator[Metric]`` and ``measure_quickly()``, the same on less data and
            without goals.
    """

    summary: str
    module: str


BENCHMARKS = {
    "generate": Benchmark(
        "the paper's geometric data set, against the bare kernels and MuJoCo's renderer (minutes)",
        "benchmarks.generate",
    ),
    "stream": Benchmark("how long a trainer waits for the endless source (minutes)", "benchmarks.endless"),
    "rollout": Benchmark(
        "control steps a second with both cameras drawn, against robosuite's own loop (minutes)",
        "benchmarks.rollout",
    ),
    "train": Benchmark(
        "samples a second of ACT's training, and the machine's own limits (minutes)",
        "benchmarks.training",
    ),
    "infer": Benchmark("how long ACT thinks, alone and for 16 environments", "benchmarks.inference"),
    "gpu": Benchmark(
        "a GPU's numbers beside the CPU's, its speed and memory, and going on after a kill (minutes)",
        "benchmarks.gpu",
    ),
    "demos": Benchmark(
        "20 demonstrations of each of the paper's arms and tasks (minutes)", "benchmarks.demos"
    ),
}

STUDIES = {
    "quickstart": "time and memory of `geoprior run` (minutes)",
    "prior": "what long priors are worth on three arms (hours)",
    "prior_factors": "each part of the recipe `sighted`, one factor at a time (an hour)",
    "prior_measures": "how cheap measures rank policies, beside rollouts (an hour)",
    "prior_over_seeds": "what the quickstart's prior is worth over five root seeds (twenty minutes)",
    "side_by_side": "fine-tunings side by side, and one after the other (minutes)",
    "train_speed": "training and prediction beside LeRobot's ACT (minutes; LeRobot needed)",
    "train_curve": "losses beside LeRobot's ACT (an hour; LeRobot needed)",
    "first_steps": "the first steps of training beside LeRobot's ACT (minutes; LeRobot needed)",
    "interval_coverage": "how often the reported intervals hold the truth (minutes)",
    "experts": "that the scripted experts succeed (minutes)",
    "open_loop_replay": "that blind replay does not (minutes)",
}
"""Modules of this folder whose ``main()`` reads the command line, and what each tells."""


def run(name: str, *, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Measure, telling each number as it comes.

    Returns:
        What `benchmarks.metrics.report` makes of them.

    Raises:
        ConfigError: There is no such benchmark.
    """
    if name not in BENCHMARKS:
        raise ConfigError(f"unknown benchmark {name!r}", suggest(name, list(BENCHMARKS), "benchmarks"))
    module = importlib.import_module(BENCHMARKS[name].module)
    measure: Callable[[], Iterator[Metric]] = module.measure_quickly if quick else module.measure
    metrics = []
    for metric in measure():
        metrics.append(metric)
        say(f"{metric.metric}: {metric.value:,.4g} {metric.unit}")
    flag = " --quick" if quick else ""
    return report(name, f"python -m benchmarks {name}{flag} --json", metrics)


__all__ = ["BENCHMARKS", "STUDIES", "as_lines", "run"]
