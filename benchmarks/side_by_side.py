"""What trials side by side cost and save: predictions by rows of the batch, and one more environment.

    python -m benchmarks side_by_side --json benchmarks/results/side_by_side.json

The network is the quickstart's, untrained, on one thread, as a rollout's worker runs it. An environment is
the quickstart's arm and task, with its first pictures drawn.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import torch

from benchmarks.metrics import Metric, as_lines, report
from geoprior.config import QUICKSTART, RunConfig, load_config
from geoprior.episode import POSE_SIZE
from geoprior.files import write_json
from geoprior.hooks.manager import plugins
from geoprior.policies.policy import Features
from geoprior.sim.workers import Setup, environments

ROWS = (1, 2, 4, 8, 16)
REPEATS = 25
POOL = 4


def predictions(config: RunConfig) -> Iterator[Metric]:
    """Median time of a prediction."""
    size = config.cameras.height, config.cameras.width
    features = Features(("hand", "third"), size, ("hand",), plugins().options("policy", config.policy).chunk)
    network = plugins().build("policy", config.policy, features).eval()
    torch.set_num_threads(1)
    for rows in ROWS:
        observation = {"pose": torch.randn(rows, POSE_SIZE), "images": torch.randn(rows, 2, 3, *size)}
        times = []
        for _ in range(REPEATS):
            began = time.perf_counter()
            network.predict(observation)
            times.append(time.perf_counter() - began)
        yield Metric(f"prediction of {rows} rows", 1e3 * median(times), "ms")


def pool(config: RunConfig) -> Iterator[Metric]:
    """Time and resident memory of each environment of a worker."""
    setup = Setup(config.robot, config.task, config.cameras, config.evaluate.look)
    for count in range(1, POOL + 1):
        before, began = _resident_mib(), time.perf_counter()
        env = environments(setup, config.demos.control_rate, count)[-1]
        env.reset(count)
        env.render()
        yield Metric(
            f"environment {count} of {POOL}, to its first pictures", time.perf_counter() - began, "s"
        )
        yield Metric(f"environment {count} of {POOL}: memory", _resident_mib() - before, "MiB")


def _resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def main() -> None:
    """Run, print, and write the JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    options = parser.parse_args()
    config = load_config(QUICKSTART, [], plugins())
    metrics = [*predictions(config), *pool(config)]
    content = report(
        "side by side",
        "python -m benchmarks side_by_side --json benchmarks/results/side_by_side.json",
        metrics,
    )
    print("\n".join(as_lines(content)))
    if options.json is not None:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
