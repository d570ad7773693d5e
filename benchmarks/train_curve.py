"""Does ACT learn here what it learns in LeRobot? Both train on the same batches from the same first weights.

    python benchmarks/train_curve.py --lerobot /path/to/lerobot/bin/python --work /tmp/curve \
        --json benchmarks/results/train_curve.json

2,000 steps at a batch of 8: sizes, learning rate and loss are LeRobot's. Ours trains as `geoprior pretrain`
does, in bfloat16. Judged by the error of the deployed policy (style zero, no
dropout) on episodes that neither has seen. LeRobot takes most of an hour; both sides go on where they were
stopped.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from geoprior.bench.metrics import Metric, as_lines, at_most, report
from geoprior.bench.training import LARGE, make_training
from geoprior.files import sha256_json, write_json
from geoprior.policies.act.lerobot_names import POSITION_TABLE, from_lerobot
from geoprior.policies.normalise import Normaliser, normalise_images
from geoprior.policies.policy import Batch
from geoprior.shards.reader import EpisodeStore
from geoprior.sources.shards import ShardSource
from geoprior.training.config import TrainConfig
from geoprior.training.data import Batches, features_of, split_slots, statistics_of
from geoprior.training.held_out import HeldOut
from geoprior.training.loop import fit
from geoprior.training.machine import Machine

WORKER = Path(__file__).with_name("lerobot_act.py")
STEPS, BATCH, CHUNK, SEED = 2_000, 8, 25, 20_000
"""Steps that are recorded, and that the goal speaks of."""
JUDGE_EVERY = 250
GOAL_PERCENT = 2.0
TRAIN, HELD_OUT = "train.safetensors", "held_out.safetensors"


def prepare(work: Path) -> None:
    """Generate 600 episodes and write down what both sides learn from and are judged by."""
    if (work / HELD_OUT).exists():
        return
    size = ("--set", "cameras.height=96", "--set", "cameras.width=96", "--set", f"seed={SEED}")
    command = [sys.executable, "-m", "geoprior", "generate", "quickstart", "--out", str(work / "data"), *size]
    subprocess.run(command, check=True)
    source = ShardSource(EpisodeStore(work / "data" / "shards" / "synthetic"), 2**28)
    kept, aside = split_slots(len(source), 0.1, SEED)
    normaliser = Normaliser(statistics_of(source, kept))
    config = TrainConfig(batch_size=BATCH, image_noise=0.0)
    features = features_of(source, CHUNK)
    learned = Batches(source, features, normaliser, config, SEED, kept)
    record(work / TRAIN, (learned.batch(step) for step in range(STEPS)))
    moments = HeldOut(source, aside, features, normaliser, config)
    record(work / HELD_OUT, moments.batches())


def record(path: Path, batches: Iterator[Batch]) -> None:
    """Write batches one after the other, frames as 0 and 1."""
    rows: dict[str, list[Tensor]] = {}
    for batch in batches:
        parts = {
            **batch,
            "frames": (batch["images"][:, :, 0] > 0).to(torch.uint8),
            "valid": batch["valid"].to(torch.uint8),
        }
        for name in ("frames", "pose", "action", "valid"):
            rows.setdefault(name, []).append(parts[name])
    save_file({name: torch.cat(tensors) for name, tensors in rows.items()}, path)


class Recorded:
    """Recorded batches, in the place of `geoprior.training.data.Batches`."""

    def __init__(self, path: Path, size: int) -> None:
        self._path, self._size = path, size

    def stream(self, first: int, last: int, parts: Sequence[int] = (0,)) -> Generator[Batch, None, None]:
        """The batches of some steps."""
        assert tuple(parts) == (0,)
        with safe_open(self._path, "pt") as file:
            for step in range(first, last):
                names = ("frames", "pose", "action", "valid")
                rows = {
                    name: file.get_slice(name)[step * self._size : (step + 1) * self._size] for name in names
                }
                images = normalise_images(255 * rows.pop("frames")[..., None])
                yield {**rows, "valid": rows["valid"].bool(), "images": images}


class Deployed:
    """Judges a policy as it is deployed, in float32; in the place of `geoprior.training.held_out.HeldOut`."""

    def __init__(self, path: Path) -> None:
        with safe_open(path, "pt") as file:
            count = file.get_slice("pose").get_shape()[0]
        self._batches = list(Recorded(path, 32).stream(0, -(-count // 32)))

    def measure(self, policy: nn.Module, _: Machine) -> dict[str, float]:
        """Mean error over valid actions, normalised."""
        policy.eval()
        total, terms = 0.0, 0
        for batch in self._batches:
            error = (policy.predict(batch) - batch["action"]).abs()[batch["valid"]]
            total += float(error.sum())
            terms += error.numel()
        policy.train()
        return {"held_out_l1": total / terms}


def learn(work: Path, steps: int, precision: str, threads: int) -> list[dict[str, Any]]:
    """Train ours; returns a row for every time it was judged."""
    folder = work / f"ours-{precision}"
    plain = make_training(
        ShardSource(EpisodeStore(work / "data" / "shards" / "synthetic")),
        LARGE,
        BATCH,
        precision,
        threads,
        epochs=steps // JUDGE_EVERY,
        checkpoint_every=1,
        learning_rate=1e-5,
        gradient_clip=10.0,
        log_every=JUDGE_EVERY,
    )
    theirs = load_file(work / "lerobot_initial.safetensors")
    named = {from_lerobot(name): tensor for name, tensor in theirs.items() if name != POSITION_TABLE}
    plain.policy.load_state_dict(named, strict=True)
    training = replace(
        plain,
        run=folder.name,
        folder=folder,
        batches=Recorded(work / TRAIN, BATCH),
        episodes=JUDGE_EVERY * BATCH,
        seed=SEED,
        fingerprint=sha256_json([{**LARGE.options, "chunk": CHUNK}, SEED, precision]),
        held_out=Deployed(work / HELD_OUT),
    )
    fit(training)
    lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return [line for line in lines if "held_out_l1" in line]


def compare(lerobot: list[dict[str, Any]], ours: dict[str, list[dict[str, Any]]], step: int) -> list[Metric]:
    """What both reached after so many steps; the goal is of `STEPS`."""
    (reference,) = (row["held_out_l1"] for row in lerobot if row["step"] == step)
    metrics = [Metric(f"LeRobot: held-out L1 after {step} steps", reference, "")]
    for precision, curve in ours.items():
        (reached,) = (row["held_out_l1"] for row in curve if row["step"] == step)
        gap = 100.0 * abs(reached / reference - 1.0)
        name = f"{precision}: distance from LeRobot's after {step} steps"
        metrics.append(Metric(f"{precision}: held-out L1 after {step} steps", reached, ""))
        metrics.append(at_most(name, gap, "%", GOAL_PERCENT) if step == STEPS else Metric(name, gap, "%"))
    return metrics


def main() -> None:
    """Train both and write what they reached."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--lerobot", required=True, help="python of an environment with LeRobot 0.4.4")
    parser.add_argument(
        "--work", type=Path, required=True, help="a folder that is kept: both sides go on in it"
    )
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    parser.add_argument("--steps", type=int, default=STEPS, help=f"a multiple of {JUDGE_EVERY}")
    parser.add_argument("--threads", type=int, default=0, help="of either side; 0 takes all cores")
    parser.add_argument("--precision", nargs="+", default=["bf16"], choices=["bf16", "fp32"], help="of ours")
    options = parser.parse_args()
    work, steps = options.work, options.steps
    work.mkdir(parents=True, exist_ok=True)
    prepare(work)
    threads = options.threads or torch.get_num_threads()
    curve = work / "lerobot_curve.json"
    if not curve.exists() or json.loads(curve.read_text())["curve"][-1]["step"] < steps:
        subprocess.run([options.lerobot, WORKER, "learn", work, str(steps), str(threads)], check=True)
    lerobot = json.loads(curve.read_text())
    ours = {precision: learn(work, steps, precision, threads) for precision in options.precision}
    arguments = f"--steps {steps} --threads {threads} --precision {' '.join(options.precision)}"
    content = report(
        "train_curve",
        f"python benchmarks/train_curve.py --lerobot PYTHON --work FOLDER {arguments}",
        compare(lerobot["curve"], ours, steps),
    )
    content["curves"] = {"lerobot": lerobot["curve"], **ours}
    content["versions"] |= {
        "lerobot": lerobot["versions"]["lerobot"],
        "lerobot's torch": lerobot["versions"]["torch"],
    }
    print("\n".join(as_lines(content)))
    if options.json:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
