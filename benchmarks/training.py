"""How fast ACT learns here, how near that is to what the machine can do, and what the loader costs."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import torch
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.clock import seconds_of
from benchmarks.metrics import Metric, at_least, at_most
from geoprior.config import load_config
from geoprior.executors.local import SerialExecutor
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.checkpoint import CheckpointHeader
from geoprior.policies.normalise import Normaliser
from geoprior.shards.reader import EpisodeStore
from geoprior.sources.shards import ShardSource
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.generate import generate
from geoprior.training.adamw import AdamW
from geoprior.training.config import TrainConfig
from geoprior.training.data import Batches, features_of, statistics_of
from geoprior.training.loop import Training
from geoprior.training.machine import Machine, arithmetic
from geoprior.training.optimise import make_optimizer, take_step
from geoprior.training.stages import build_policy

if TYPE_CHECKING:
    from geoprior.policies.policy import Batch
    from geoprior.sources.source import Source

SIZE, SEED = 96, 40_000
COMPACT = load_config("compact", (), plugins()).policy
"""The policy of the packaged config `compact`."""
LARGE = Choice(name="act", options={"dim": 512, "ffn": 3200, "trunk_norm": "frozen", "padding": "all"})
"""The sizes that the original ACT and LeRobot's have."""
RATE_GOAL, LOADER_GOAL = 200.0, 0.03
BYTES_A_WEIGHT = 28
"""What AdamW moves for each weight: it reads weight, two means and gradient, and writes all but the last."""


@dataclass(frozen=True)
class Rates:
    """What this machine can do at its best.

    Attributes:
        operations: Of a large matrix product, a second; an addition and a multiplication are two.
        bytes: To and from memory, a second.
    """

    operations: float
    bytes: float


def measure() -> Iterator[Metric]:
    """The compact policy through loader and loop, then the large one in both precisions (some 3 minutes)."""
    yield from _measure(rounds=5, steps=3, goals=True)


def measure_quickly() -> Iterator[Metric]:
    """The same with two short rounds."""
    yield from _measure(rounds=2, steps=1, goals=False)


def _measure(*, rounds: int, steps: int, goals: bool) -> Iterator[Metric]:
    threads = torch.get_num_threads()
    with (
        tempfile.TemporaryDirectory() as folder,
        closing(make_source(Path(folder))) as source,
        arithmetic(Machine("cpu", "fp32", threads)),
    ):
        yield from _measure_loop(source, 2 * rounds - 1, steps + 1, threads, goals=goals)
        measured = _Rounds(threads, rounds, steps)
        yield from measured.steps_of(source, "compact", COMPACT, 64, "bf16")
        for precision in ("bf16", "fp32"):
            for size in (8, 32):
                yield from measured.steps_of(source, "dim 512", LARGE, size, precision)


def make_source(folder: Path) -> ShardSource:
    """Sixty episodes of the quickstart's kind, in frames of `SIZE`."""
    config = GenerateConfig(fps=10.0, seconds=10.0, episodes=20)
    cameras = CamerasConfig(height=SIZE, width=SIZE)
    generate(config, cameras, seed=SEED, executor=SerialExecutor(), out=folder)
    return ShardSource(EpisodeStore(folder), 2**28)


def make_training(
    source: Source, choice: Choice, batch_size: int, precision: str, threads: int, **options: Any
) -> Training:
    """A training that writes nothing: for `take_step`."""
    config = TrainConfig(batch_size=batch_size, precision=precision, threads=threads, **options)
    features = features_of(source, 25)
    statistics = statistics_of(source)
    return Training(
        run="benchmark",
        folder=Path(),
        config=config,
        policy=build_policy(choice, features, SEED).train(),
        batches=Batches(source, features, Normaliser(statistics), config, SEED),
        episodes=len(source),
        seed=SEED,
        machine=Machine("cpu", precision, threads),
        header=CheckpointHeader(choice, features, source.fps, statistics, 0, 0, {}),
        fingerprint="",
    )


def _measure_loop(source: Source, rounds: int, steps: int, threads: int, *, goals: bool) -> Iterator[Metric]:
    """Steps with a loader beside them, as a training has them, in turn with steps alone."""
    training = make_training(source, COMPACT, 64, "bf16", threads)
    optimizer = make_optimizer(training.config, training.policy, training.machine)
    batch = training.batches.batch(0)
    times_of_steps(training, optimizer, batch, 3)
    costs, waits, beside = [], [], []
    for turn in range(rounds):
        alone = median(times_of_steps(training, optimizer, batch, steps))
        waited, whole = _loop(training, optimizer, turn * (steps + 2), steps)
        costs.append(median(whole) / alone - 1.0)
        waits += waited
        beside += whole
    count = sum(parameter.numel() for parameter in training.policy.parameters())
    yield Metric("compact: parameters", count / 1e6, "million")
    rate, cost = 64 / median(beside), median(costs)
    name, loader = (
        "compact: 2 cameras, batch 64, bf16",
        "compact: what the loader adds to a step",
    )
    yield at_least(name, rate, "samples/s", RATE_GOAL) if goals else Metric(name, rate, "samples/s")
    yield at_most(loader, cost, "", LOADER_GOAL) if goals else Metric(loader, cost, "")
    yield Metric("compact: share of time that a step waits for its batch", sum(waits) / sum(beside), "")


def _loop(training: Training, optimizer: AdamW, first: int, steps: int) -> tuple[list[float], list[float]]:
    """Seconds that steps waited for their batch, and that they took in all; two steps warm up."""
    waits, whole = [], []
    last = first + steps + 2
    with closing(training.batches.stream(first, last)) as batches:
        for step in range(first, last):
            begun = time.perf_counter()
            batch = next(batches)
            waits.append(time.perf_counter() - begun)
            take_step(training, optimizer, step, {0: batch})
            whole.append(time.perf_counter() - begun)
    return waits[2:], whole[2:]


@dataclass(frozen=True)
class _Rounds:
    """Slices of steps, in turn with a measurement of what the machine can do at that moment."""

    threads: int
    rounds: int
    steps: int

    def steps_of(
        self, source: Source, label: str, choice: Choice, batch_size: int, precision: str
    ) -> Iterator[Metric]:
        """How long a step takes, and how long it would by arithmetic and memory alone."""
        training = make_training(source, choice, batch_size, precision, self.threads)
        optimizer = make_optimizer(training.config, training.policy, training.machine)
        batch = training.batches.batch(0)
        times_of_steps(training, optimizer, batch, 2)
        slices = []
        for _ in range(self.rounds):
            rates = machine_rates(torch.bfloat16 if precision == "bf16" else torch.float32)
            slices.append((rates, median(times_of_steps(training, optimizer, batch, self.steps))))
        name = f"{label}, batch {batch_size}, {precision}"
        seconds = median(took for _, took in slices)
        yield Metric(name, batch_size / seconds, "samples/s")
        operations = operations_of(training, optimizer, batch)
        moved = BYTES_A_WEIGHT * sum(parameter.numel() for parameter in training.policy.parameters())
        yield Metric(f"{name}: arithmetic of a step", operations / 1e9, "GFLOP")
        floors = [operations / rates.operations + moved / rates.bytes for rates, _ in slices]
        yield Metric(f"{name}: floor of a step by arithmetic and AdamW's memory", 1e3 * median(floors), "ms")
        over = median(took / floor for (_, took), floor in zip(slices, floors, strict=True))
        yield Metric(f"{name}: a step over its floor", over, "x")
        rate = median(rates.operations for rates, _ in slices) / 1e9
        yield Metric(f"{name}: matrix products meanwhile", rate, "GFLOP/s")


def times_of_steps(training: Training, optimizer: AdamW, batch: Batch, count: int) -> list[float]:
    """Seconds of so many optimiser steps on the same batch."""
    return [seconds_of(take_step, training, optimizer, step, {0: batch}) for step in range(count)]


def operations_of(training: Training, optimizer: AdamW, batch: Batch) -> float:
    """Floating-point operations of the products and convolutions of one step, forward and backward."""
    with FlopCounterMode(display=False) as counter:
        take_step(training, optimizer, 0, {0: batch})
    return float(counter.get_total_flops())


def machine_rates(dtype: torch.dtype, size: int = 1536) -> Rates:
    """The best of a few large products, and of a few copies of 256 MB."""
    a = torch.ones(size, size, dtype=dtype)
    numbers = torch.ones(2**25)
    copy = torch.empty_like(numbers)
    product = min(seconds_of(torch.mm, a, a) for _ in range(6))
    copied = min(seconds_of(copy.copy_, numbers) for _ in range(4))
    return Rates(2.0 * size**3 / product, 2.0 * 4 * numbers.numel() / copied)
