"""Samples a second of ACT's training, and milliseconds of a prediction, beside LeRobot's ACT.

    python -m benchmarks train_speed --lerobot /path/to/lerobot/bin/python \
        --json benchmarks/results/train_speed.json

LeRobot 0.4.4 runs as it comes, in an environment and a process of its own: its sizes, float32, its AdamW
and its clipping. Ours has the same sizes, frozen batch norm and clipping, and is stepped by the code of the
training loop. Both get two cameras of 96x96 and chunks of 25, take turns, and use all cores; what is told are
medians over the rounds and the extremes. Leave the machine alone meanwhile (some 6 minutes).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from statistics import median
from typing import IO, cast

import torch

from benchmarks.inference import make_predictor, times_of_predictions
from benchmarks.metrics import Metric, at_least, at_most, report
from benchmarks.training import LARGE, machine_rates, make_source, make_training, times_of_steps
from geoprior.files import write_json
from geoprior.training.machine import Machine, arithmetic
from geoprior.training.optimise import make_optimizer

WORKER = Path(__file__).with_name("lerobot_act.py")
BATCHES, ROWS, PRECISIONS = (8, 32), (1, 16), ("bf16", "fp32")
TRAIN_GOAL, INFER_GOAL = 4.0, 0.25
CLIP = 10.0


class LeRobot:
    """LeRobot's side, in its own process."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._in, self._out = cast("IO[str]", process.stdin), cast("IO[str]", process.stdout)
        self.versions: dict[str, str] = json.loads(self._out.readline())

    def times(self, kind: str, size: int, count: int) -> list[float]:
        """Seconds of so many steps (``train``) or predictions (``infer``)."""
        self._in.write(f"{kind} {size} {count}\n")
        self._in.flush()
        times: list[float] = json.loads(self._out.readline())
        return times


def measure_training(lerobot: LeRobot, rounds: int, steps: int) -> Iterator[Metric]:
    """Steps of both sides, in turn."""
    threads = torch.get_num_threads()
    with (
        tempfile.TemporaryDirectory() as folder,
        closing(make_source(Path(folder))) as source,
        arithmetic(Machine("cpu", "fp32", threads)),
    ):
        for size in BATCHES:
            sides = {}
            for precision in PRECISIONS:
                options = {"gradient_clip": CLIP, "learning_rate": 1e-5, "image_noise": 0.0}
                training = make_training(source, LARGE, size, precision, threads, **options)
                optimizer = make_optimizer(training.config, training.policy, training.machine)
                sides[precision] = (training, optimizer, training.batches.batch(0))
                times_of_steps(*sides[precision], 2)
            lerobot.times("train", size, 2)
            theirs: list[float] = []
            ours: dict[str, list[float]] = {precision: [] for precision in PRECISIONS}
            rates = []
            for _ in range(rounds):
                theirs.append(median(lerobot.times("train", size, steps)))
                rates.append(machine_rates(torch.bfloat16).operations / 1e9)
                for precision in PRECISIONS:
                    ours[precision].append(median(times_of_steps(*sides[precision], steps)))
            yield from told(f"LeRobot, batch {size}", [size / t for t in theirs], "samples/s")
            yield from told(f"batch {size}: bf16 matrix products meanwhile", rates, "GFLOP/s")
            for precision, times in ours.items():
                name = f"{precision}, batch {size}"
                yield from told(name, [size / t for t in times], "samples/s")
                ratios = [a / b for a, b in zip(theirs, times, strict=True)]
                yield from told(
                    f"{name}: over LeRobot", ratios, "x", TRAIN_GOAL if precision == "bf16" else None
                )


def measure_inference(lerobot: LeRobot, rounds: int, count: int) -> Iterator[Metric]:
    """Predictions of both sides, in turn."""
    sides = {precision: make_predictor(LARGE, half=precision == "bf16") for precision in PRECISIONS}
    for rows in ROWS:
        lerobot.times("infer", rows, 3)
        for predictor in sides.values():
            times_of_predictions(predictor, rows, 3)
        theirs: list[float] = []
        ours: dict[str, list[float]] = {precision: [] for precision in PRECISIONS}
        for _ in range(rounds):
            theirs.append(median(lerobot.times("infer", rows, count)))
            for precision, predictor in sides.items():
                ours[precision].append(median(times_of_predictions(predictor, rows, count)))
        yield from told(f"LeRobot, {rows} observations", [1e3 * t for t in theirs], "ms")
        for precision, times in ours.items():
            name = f"{precision}, {rows} observations"
            yield from told(name, [1e3 * t for t in times], "ms")
            shares = [b / a for a, b in zip(theirs, times, strict=True)]
            goal = INFER_GOAL if (precision, rows) == ("bf16", 1) else None
            yield from told(f"{name}: of LeRobot's time", shares, "", goal)


def told(name: str, values: list[float], unit: str, goal: float | None = None) -> Iterator[Metric]:
    """The median and the extremes of the rounds."""
    middle = median(values)
    if goal is None:
        yield Metric(name, middle, unit)
    else:
        yield (at_least if goal > 1.0 else at_most)(name, middle, unit, goal)
    yield Metric(f"{name}: lowest round", min(values), unit)
    yield Metric(f"{name}: highest round", max(values), unit)


def main() -> None:
    """Measure, print, and write the JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--lerobot", required=True, help="python of an environment with LeRobot 0.4.4")
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    command = [options.lerobot, str(WORKER), "serve"]
    metrics = []
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        lerobot = LeRobot(process)
        for measured in (
            measure_training(lerobot, options.rounds, 3),
            measure_inference(lerobot, options.rounds, 15),
        ):
            for metric in measured:
                metrics.append(metric)
                print(f"{metric.metric}: {metric.value:,.4g} {metric.unit}", flush=True)
        cast("IO[str]", process.stdin).close()
    content = report(
        "train_speed", f"python -m benchmarks train_speed --lerobot PYTHON --rounds {options.rounds}", metrics
    )
    content["versions"] |= {
        "lerobot": lerobot.versions["lerobot"],
        "lerobot's torch": lerobot.versions["torch"],
    }
    if options.json:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
