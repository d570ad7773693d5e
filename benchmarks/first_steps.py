"""Do both take the same first steps? LeRobot's ACT and ours, from the same weights, batches and draws.

    python -m benchmarks first_steps --lerobot /path/to/lerobot/bin/python --work /tmp/curve \
        --json benchmarks/results/first_steps.json

Losses after a step depend on the whole of it: forward and backward pass, clipping and AdamW. Training then
drives the smallest rounding apart, so that what train_curve.py finds after 2,000 steps is chance as well.
"""

from __future__ import annotations

import argparse
import json
import subprocess
from contextlib import closing
from pathlib import Path

import torch

from benchmarks.metrics import Metric, as_lines, report
from benchmarks.train_curve import PRECISIONS, SAME_NOISE, STEPS, WORKER, our_training, prepare, write_terms
from geoprior.files import write_json
from geoprior.training.optimise import make_optimizer, take_step

LOOKED_AT = (1, 2, 5, 10, 20)


def their_losses(work: Path, python: str, threads: int) -> list[float]:
    """L1 of each step in LeRobot."""
    name = write_terms(work, SAME_NOISE)
    command = [python, WORKER, "first", work, name, str(LOOKED_AT[-1]), str(threads)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    losses: list[float] = json.loads(done.stdout.splitlines()[-1])
    return losses


def our_losses(work: Path, precision: str, threads: int) -> list[float]:
    """L1 of each step in ours."""
    torch.set_num_threads(threads)
    training = our_training(work, SAME_NOISE, STEPS, precision, threads)
    optimizer = make_optimizer(training.config, training.policy, training.machine)
    with closing(training.batches.stream(0, LOOKED_AT[-1])) as batches:
        return [take_step(training, optimizer, step, {0: batch})["l1"] for step, batch in enumerate(batches)]


def main() -> None:
    """Take the steps and write how far apart they are."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--lerobot", required=True, help="python of an environment with LeRobot 0.4.4")
    parser.add_argument("--work", type=Path, required=True, help="a folder that is kept")
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    prepare(options.work)
    theirs = their_losses(options.work, options.lerobot, threads=1)
    metrics = []
    for precision in PRECISIONS:
        ours = our_losses(options.work, precision, threads=1)
        for step in LOOKED_AT:
            gap = abs(ours[step - 1] / theirs[step - 1] - 1.0)
            metrics.append(Metric(f"{precision}: relative distance of the L1 loss at step {step}", gap, ""))
    command = "python -m benchmarks first_steps --lerobot PYTHON --work FOLDER"
    content = report("first_steps", command, metrics)
    print("\n".join(as_lines(content)))
    if options.json:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
