"""Does ACT learn here what it learns in LeRobot? Both train on the same batches from the same first weights.

    python -m benchmarks train_curve --lerobot /path/to/lerobot/bin/python --work /tmp/curve \
        --json benchmarks/results/train_curve.json

2,000 steps at a batch of 8: sizes, learning rate and loss are LeRobot's. Ours trains as `geoprior pretrain`
does. Judged by the error of the deployed policy (style zero, no dropout) on episodes that neither has seen.

Both draw dropout and styles at random, each in its own way, and so end apart by chance. ``--repeat`` trains
LeRobot a second time with other draws, which says how far. ``--same-noise`` takes chance away: both train
without dropout and with the same styles.

Even then the smallest rounding drives two trainings apart. ``--nudge`` trains both once more on the terms of
``--same-noise`` from first weights that are moved by a unit in the last place, which says how far.

LeRobot takes most of an hour for each 2,000 steps; all sides go on where they were stopped.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any, cast

import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from benchmarks.metrics import Metric, as_lines, at_most, report
from benchmarks.training import LARGE, make_training
from geoprior.files import sha256_json, write_json
from geoprior.geometry.seeding import integer_seed
from geoprior.options import Choice
from geoprior.policies.act.lerobot_names import POSITION_TABLE, from_lerobot
from geoprior.policies.checkpoint import list_checkpoints, load_weights
from geoprior.policies.normalise import Normaliser, normalise_images
from geoprior.policies.policy import Batch, Policy
from geoprior.shards.reader import EpisodeStore
from geoprior.sources.shards import ShardSource
from geoprior.training.config import TrainConfig
from geoprior.training.data import Batches, features_of, split_slots, statistics_of
from geoprior.training.held_out import HeldOut
from geoprior.training.loop import Training, fit

WORKER = Path(__file__).with_name("lerobot_act.py")
STEPS, BATCH, CHUNK, SEED = 2_000, 8, 25, 20_000
"""Steps that are recorded, and that the goal speaks of."""
JUDGE_EVERY = 250
GOAL_PERCENT = 2.0
PRECISIONS = ("bf16", "fp32")
TRAIN, HELD_OUT = "train.safetensors", "held_out.safetensors"


@dataclass(frozen=True)
class Terms:
    """On which both sides train.

    Attributes:
        suffix: Of the names of what is kept in the folder.
        dropout: Its probability.
        seeds: Of LeRobot's randomness, one for each step.
        nudge: What the first weights are multiplied with.
    """

    suffix: str
    dropout: float
    seeds: list[int]
    nudge: float = 1.0


AS_THEY_COME = Terms("", 0.1, list(range(1, STEPS + 1)))
REPEATED = Terms("-again", 0.1, list(range(100_001, 100_001 + STEPS)))
SAME_NOISE = Terms("-same-noise", 0.0, [integer_seed(SEED, "step", step) for step in range(STEPS)])
NUDGED = replace(SAME_NOISE, suffix="-nudged", nudge=1.0 + 2.0**-23)


def prepare(work: Path) -> None:
    """Generate 600 episodes and write down what both sides learn from and are judged by."""
    if (work / HELD_OUT).exists():
        return
    size = ("--set", "cameras.height=96", "--set", "cameras.width=96", "--set", f"seed={SEED}")
    command = [sys.executable, "-m", "geoprior", "generate", "lite", "--out", str(work / "data"), *size]
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


def held_out_l1(policy: nn.Module, work: Path) -> float:
    """Mean error of the policy as it is deployed, in float32, over valid actions, normalised."""
    path = work / HELD_OUT
    with safe_open(path, "pt") as file:
        count = file.get_slice("pose").get_shape()[0]
    policy.eval()
    total, terms = 0.0, 0
    for batch in Recorded(path, 32).stream(0, -(-count // 32)):
        error = (cast("Policy", policy).predict(batch) - batch["action"]).abs()[batch["valid"]]
        total += float(error.sum())
        terms += error.numel()
    return total / terms


def write_terms(work: Path, terms: Terms) -> str:
    """Tell LeRobot's side the terms; returns the name by which it finds them."""
    name = f"lerobot{terms.suffix}"
    write_json(work / f"{name}.json", {"dropout": terms.dropout, "seeds": terms.seeds, "nudge": terms.nudge})
    return name


def learn_theirs(work: Path, python: str, terms: Terms, steps: int, threads: int) -> dict[str, Any]:
    """Train LeRobot's; returns its versions and a row for every time it was judged."""
    name = write_terms(work, terms)
    curve = work / f"{name}_curve.json"
    if not curve.exists() or json.loads(curve.read_text())["curve"][-1]["step"] < steps:
        subprocess.run([python, WORKER, "learn", work, name, str(steps), str(threads)], check=True)
    found: dict[str, Any] = json.loads(curve.read_text())
    return found


def our_training(work: Path, terms: Terms, steps: int, precision: str, threads: int) -> Training:
    """Ours, from LeRobot's first weights and on the recorded batches."""
    folder = work / f"ours-{precision}{terms.suffix}"
    choice = Choice(name=LARGE.name, options={**LARGE.options, "dropout": terms.dropout})
    plain = make_training(
        ShardSource(EpisodeStore(work / "data" / "shards" / "synthetic")),
        choice,
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
    named = {
        from_lerobot(name): terms.nudge * tensor for name, tensor in theirs.items() if name != POSITION_TABLE
    }
    plain.policy.load_state_dict(named, strict=True)
    return replace(
        plain,
        run=folder.name,
        folder=folder,
        batches=Recorded(work / TRAIN, BATCH),
        episodes=JUDGE_EVERY * BATCH,
        seed=SEED,
        fingerprint=sha256_json([choice.options, CHUNK, SEED, precision, terms.nudge]),
    )


def learn_ours(work: Path, terms: Terms, steps: int, precision: str, threads: int) -> list[dict[str, Any]]:
    """Train ours; returns a row for every time it was judged."""
    training = our_training(work, terms, steps, precision, threads)
    fit(training)
    lines = [json.loads(line) for line in (training.folder / "log.jsonl").read_text().splitlines()]
    l1 = {line["step"]: line["l1"] for line in lines}
    curve = []
    for checkpoint in list_checkpoints(training.folder):
        load_weights(training.policy, checkpoint.path)
        step = checkpoint.epoch * JUDGE_EVERY
        curve.append({"step": step, "l1": l1[step], "held_out_l1": held_out_l1(training.policy, work)})
    return curve


def compare(curves: dict[str, list[dict[str, Any]]], step: int) -> list[Metric]:
    """What all reached after so many steps, and how far from LeRobot's, which comes first.

    The goal is ours and of `STEPS`.
    """
    reached = {
        name: next(row["held_out_l1"] for row in curve if row["step"] == step)
        for name, curve in curves.items()
    }
    later = {
        name: fmean(row["held_out_l1"] for row in curve if step / 2 < row["step"] <= step)
        for name, curve in curves.items()
    }
    reference = reached["LeRobot"]
    metrics = [
        Metric(f"{name}: held-out L1 after {step} steps", value, "") for name, value in reached.items()
    ]
    for name, value in reached.items():
        gap = _gap(value, reference)
        metric = f"{name}: distance from LeRobot's after {step} steps"
        if name in PRECISIONS and step == STEPS:
            metrics.append(at_most(metric, gap, "%", GOAL_PERCENT))
        elif name != "LeRobot":
            metrics.append(Metric(metric, gap, "%"))
    metrics += [Metric(f"{name}: mean over the later half", value, "") for name, value in later.items()]
    for name in PRECISIONS:
        if f"{name} nudged" in curves:
            metrics += [
                Metric(f"{name}: mean of two trainings, distance from LeRobot's, {when}", gap, "%")
                for when, gap in (
                    (f"after {step} steps", _gap_of_pairs(reached, name)),
                    ("over the later half", _gap_of_pairs(later, name)),
                )
            ]
    return metrics


def _gap(value: float, reference: float) -> float:
    """In per cent."""
    return 100.0 * abs(value / reference - 1.0)


def _gap_of_pairs(values: dict[str, float], name: str) -> float:
    """The same between the mean of two trainings and that of LeRobot's two."""
    return _gap(*(fmean((values[one], values[f"{one} nudged"])) for one in (name, "LeRobot")))


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
    parser.add_argument("--precision", nargs="*", default=["bf16"], choices=PRECISIONS, help="of ours")
    parser.add_argument("--same-noise", action="store_true", help="without dropout, styles drawn alike")
    parser.add_argument("--repeat", action="store_true", help="train LeRobot once more, with other draws")
    parser.add_argument("--nudge", action="store_true", help="train both once more, from weights a unit away")
    options = parser.parse_args()
    if options.nudge and not options.same_noise:
        parser.error("--nudge compares trainings on the terms of --same-noise: give both")
    work, steps = options.work, options.steps
    work.mkdir(parents=True, exist_ok=True)
    prepare(work)
    threads = options.threads or torch.get_num_threads()
    terms = SAME_NOISE if options.same_noise else AS_THEY_COME
    lerobot = learn_theirs(work, options.lerobot, terms, steps, threads)
    curves = {"LeRobot": lerobot["curve"]}
    if options.repeat:
        curves["LeRobot again"] = learn_theirs(work, options.lerobot, REPEATED, steps, threads)["curve"]
    for precision in options.precision:
        curves[precision] = learn_ours(work, terms, steps, precision, threads)
    if options.nudge:
        curves["LeRobot nudged"] = learn_theirs(work, options.lerobot, NUDGED, steps, threads)["curve"]
        for precision in options.precision:
            curves[f"{precision} nudged"] = learn_ours(work, NUDGED, steps, precision, threads)
    flags = [
        f"--{flag.replace('_', '-')}" for flag in ("same_noise", "repeat", "nudge") if getattr(options, flag)
    ]
    arguments = [f"--steps {steps} --threads {threads} --precision {' '.join(options.precision)}", *flags]
    content = report(
        "train_curve",
        f"python -m benchmarks train_curve --lerobot PYTHON --work FOLDER {' '.join(arguments)}",
        compare(curves, steps),
    )
    content["curves"] = curves
    content["versions"] |= {
        "lerobot": lerobot["versions"]["lerobot"],
        "lerobot's torch": lerobot["versions"]["torch"],
    }
    print("\n".join(as_lines(content)))
    if options.json:
        write_json(options.json, content)


if __name__ == "__main__":
    main()
