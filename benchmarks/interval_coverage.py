"""How often the intervals of a difference hold the truth, in studies that are made up.

    python -m benchmarks interval_coverage --json benchmarks/results/interval_coverage.json

Every study has two conditions, some training seeds and some initial states that all trainings meet. A
training has a luck of its own, which lasts through its whole curve, and a state its difficulty (both normal,
in log-odds). The interval that geoprior reports is held against a bare one, whose draws of training seeds are
not stretched. Some two minutes; nothing is timed.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks.metrics import Metric, as_lines, at_least, report
from geoprior.files import write_json
from geoprior.study import statistics
from geoprior.study.statistics import Interval, paired_interval

STUDIES, RESAMPLES, STATES = 400, 1000, 50
SEEDS = (1, 2, 3, 5, 10)
LUCKS = {"trainings all alike": 0.0, "trainings differ": 0.5, "trainings differ much": 1.3}
CURVES = {"one checkpoint": 1, "area over six": 6}
SHIFT = 1.0
"""Between the conditions, in log-odds: 62 against 38 % where nothing else differs."""
CLOSE_TO_95 = 91.0
"""Percent: what 400 studies of an interval of 95 % seldom fall below."""


def chances(rng: np.random.Generator, seeds: int, states: int, luck: float) -> NDArray[np.float64]:
    """(2, seeds, states) chances of success."""
    odds = np.array([SHIFT / 2, -SHIFT / 2])[:, None, None]
    trainings, difficulty = rng.normal(size=(2, seeds, 1)), rng.normal(size=(1, 1, states))
    return 1.0 / (1.0 + np.exp(-odds - luck * trainings - difficulty))


def bare_interval(table: NDArray[np.float64], rng: np.random.Generator) -> Interval:
    """`paired_interval` without the stretching of seeds."""
    stretch = statistics._stretch
    try:
        statistics._stretch = lambda *_: 1.0
        return paired_interval(table, rng, samples=RESAMPLES)
    finally:
        statistics._stretch = stretch


def measure() -> Iterator[Metric]:
    """Coverage in percent and median width in points, for every kind of study."""
    for seeds in SEEDS:
        for curve, checkpoints in CURVES.items():
            for name, luck in LUCKS.items():
                if seeds > 1 or luck == 0.0:
                    yield from _measure(f"{seeds} x {STATES}, {curve}, {name}", seeds, checkpoints, luck)


def _measure(name: str, seeds: int, checkpoints: int, luck: float) -> Iterator[Metric]:
    rng = np.random.default_rng([seeds, checkpoints, round(10 * luck)])
    first, second = chances(rng, 3000, 3000, luck)
    truth = float((first - second).mean())
    held: dict[str, list[bool]] = {"bare": [], "as reported": []}
    widths = []
    for _ in range(STUDIES):
        chance = chances(rng, seeds, STATES, luck)[..., None]
        first, second = (rng.random((*chance.shape[:-1], checkpoints)) < chance).mean(axis=-1)
        intervals = {
            "bare": bare_interval(first - second, rng),
            "as reported": paired_interval(first - second, rng, samples=RESAMPLES),
        }
        for kind, found in intervals.items():
            held[kind].append(found.low <= truth <= found.high)
        widths.append(intervals["as reported"].high - intervals["as reported"].low)
    yield Metric(f"{name}: bare", 100.0 * sum(held["bare"]) / STUDIES, "%")
    yield at_least(f"{name}: as reported", 100.0 * sum(held["as reported"]) / STUDIES, "%", CLOSE_TO_95)
    yield Metric(f"{name}: median width", 100.0 * median(widths), "points")


def main() -> None:
    """Measure, print, and write the JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    options = parser.parse_args()
    content = report("interval_coverage", "python -m benchmarks interval_coverage", list(measure()))
    print("\n".join(as_lines(content)))
    if options.json:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
