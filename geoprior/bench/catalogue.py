"""The benchmarks by name, and how one is run."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from geoprior.bench.metrics import Metric, as_lines, report
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
        "geoprior.bench.generate",
    ),
    "stream": Benchmark(
        "how long a trainer waits for the endless source (minutes)", "geoprior.bench.endless"
    ),
    "rollout": Benchmark(
        "control steps a second with both cameras drawn, against robosuite's own loop (minutes)",
        "geoprior.bench.rollout",
    ),
    "train": Benchmark(
        "samples a second of ACT's training, and the machine's own limits (minutes)",
        "geoprior.bench.training",
    ),
    "infer": Benchmark("how long ACT thinks, alone and for 16 environments", "geoprior.bench.inference"),
    "demos": Benchmark(
        "20 demonstrations of each of the paper's arms and tasks (minutes)", "geoprior.bench.demos"
    ),
}


def run(name: str, *, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Measure, telling each number as it comes.

    Returns:
        What `geoprior.bench.metrics.report` makes of them.

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
    return report(name, f"geoprior bench {name}{flag} --json", metrics)


__all__ = ["BENCHMARKS", "as_lines", "run"]
