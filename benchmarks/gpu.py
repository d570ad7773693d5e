"""What a GPU does with this code: the same numbers as a CPU, how fast, in how much memory, and what is left.

It needs the core alone, no simulation and no GL. On a machine without a GPU it measures the CPU, and says so;
nothing is claimed of a GPU then.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from unittest.mock import patch

import torch

from benchmarks.metrics import Metric, at_least, at_most
from benchmarks.training import LARGE, SEED, make_training
from geoprior.config import load_config
from geoprior.executors.local import SerialExecutor
from geoprior.files import sha256_file
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.checkpoint import list_checkpoints
from geoprior.shards.reader import EpisodeStore
from geoprior.sources.shards import ShardSource
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.generate import generate
from geoprior.training.loop import Training
from geoprior.training.machine import Machine, arithmetic
from geoprior.training.optimise import make_optimizer, take_step

SAME = 1e-3
"""Relative difference of the L1 in float32 between a GPU and a CPU, at most, over `STEPS` steps."""
STEPS = 20
_WARM_UP = 3
_KILL_AFTER, _PATIENCE = 0.2, 300.0


@dataclass(frozen=True)
class Size:
    """One network on frames of one size.

    Attributes:
        name: For people.
        height: Of the frames, pixels.
        width: Of the frames, pixels.
        policy: The network.
        batches: Samples of a step, each measured.
    """

    name: str
    height: int
    width: int
    policy: Choice
    batches: tuple[int, ...]


QUICKSTART = Size("quickstart", 64, 64, load_config("quickstart", (), plugins()).policy, (16,))
SIZES = (
    QUICKSTART,
    Size("dim 512 at 96x96", 96, 96, LARGE, (8, 32)),
    Size("paper at 480x640", 480, 640, load_config("paper", (), plugins()).policy, (8,)),
)


def measure() -> Iterator[Metric]:
    """Everything, at the sizes that people train."""
    yield from _measure(SIZES, steps=30)


def measure_quickly() -> Iterator[Metric]:
    """The smallest network, few steps."""
    small = Choice(name="act", options={**QUICKSTART.policy.options, "dim": 32, "ffn": 64, "trunk_width": 8})
    yield from _measure((replace(QUICKSTART, policy=small, batches=(4,)),), steps=2)


def _measure(sizes: tuple[Size, ...], *, steps: int) -> Iterator[Metric]:
    device = "cuda" if torch.cuda.is_available() else "cpu"
    yield Metric("a GPU was there", float(device == "cuda"), "")
    for size in sizes:
        with tempfile.TemporaryDirectory() as folder, closing(_source(Path(folder), size)) as source:
            if size.name == QUICKSTART.name:
                yield at_most(
                    "fp32: losses beside the CPU's", _loss_difference(source, size, device), "", SAME
                )
            rates = {}
            for batch_size in size.batches:
                for precision in ("bf16", "fp32"):
                    rates[precision] = yield from _speed(source, size, batch_size, precision, device, steps)
            if "paper" in size.name:
                yield Metric("hours of paper.yaml's trainings, bf16", _hours(rates["bf16"]), "h")
    yield from _killed(device)


def _source(folder: Path, size: Size) -> ShardSource:
    generate(
        GenerateConfig(fps=5.0, seconds=4.0, episodes=3, renderer=Choice(name="solids")),
        CamerasConfig(height=size.height, width=size.width),
        seed=SEED,
        executor=SerialExecutor(),
        out=folder,
    )
    return ShardSource(EpisodeStore(folder), 2**28)


def _training(source: ShardSource, size: Size, batch_size: int, precision: str, device: str) -> Training:
    threads = torch.get_num_threads()
    made = make_training(source, size.policy, batch_size, precision, threads, loader_workers=2)
    return replace(made, policy=made.policy.to(device), machine=Machine(device, precision, threads))


def _loss_difference(source: ShardSource, size: Size, device: str) -> float:
    """The largest relative difference over some steps, with nothing random inside a step."""
    calm = replace(size, policy=Choice(name="act", options={**size.policy.options, "dropout": 0.0}))
    losses = [_losses(source, calm, where) for where in ("cpu", device)]
    return max(abs(ours - theirs) / abs(theirs) for theirs, ours in zip(*losses, strict=True))


def _losses(source: ShardSource, size: Size, device: str) -> list[float]:
    training = _training(source, size, size.batches[0], "fp32", device)
    with arithmetic(training.machine), _without_noise():
        optimizer = make_optimizer(training.config, training.policy, training.machine)
        batches = [training.batches.batch(step) for step in range(STEPS)]
        return [take_step(training, optimizer, step, {0: batch})["l1"] for step, batch in enumerate(batches)]


@contextmanager
def _without_noise() -> Iterator[None]:
    """Devices draw other numbers from the same seed: the style variable is its mean."""
    with patch.object(torch, "randn_like", torch.zeros_like):
        yield


def _speed(
    source: ShardSource, size: Size, batch_size: int, precision: str, device: str, steps: int
) -> Iterator[Metric]:
    """Steps with the loader beside them, as a training has them; returns samples a second."""
    training = _training(source, size, batch_size, precision, device)
    if device == "cuda":
        torch.cuda.reset_peak_memory_stats()
    times = []
    with (
        arithmetic(training.machine),
        closing(training.batches.stream(0, _WARM_UP + steps)) as batches,
    ):
        optimizer = make_optimizer(training.config, training.policy, training.machine)
        for step in range(_WARM_UP + steps):
            begun = time.perf_counter()
            take_step(training, optimizer, step, {0: next(batches)})  # reads the loss: waits for the GPU
            times.append(time.perf_counter() - begun)
    rate = batch_size / median(times[_WARM_UP:])
    name = f"{size.name}, batch {batch_size}, {precision}"
    yield Metric(f"{name}: loader included", rate, "samples/s")
    if device == "cuda":
        yield Metric(f"{name}: memory", torch.cuda.max_memory_allocated() / 2**20, "MiB")
    return rate


def _hours(rate: float) -> float:
    """Of paper.yaml's pretraining and fine-tunings, one after the other."""
    config = load_config("paper", (), plugins())
    synthetic = config.pretrain.epochs * config.generate.episodes * len(config.generate.motions)
    trainings = len(config.finetune.conditions) * len(config.finetune.seeds)
    robot = config.finetune.epochs * config.demos.episodes * trainings
    return (synthetic + robot) / rate / 3600.0


def _killed(device: str) -> Iterator[Metric]:
    """A training that is killed and goes on ends with the weights of one that was left alone."""
    with tempfile.TemporaryDirectory() as folder:
        whole, cut = Path(folder) / "whole", Path(folder) / "cut"
        for out in (whole, cut):
            subprocess.run(_command("generate", out), check=True, capture_output=True)
        subprocess.run(_command("pretrain", whole), check=True, capture_output=True)
        _kill_on_the_way(_command("pretrain", cut), cut / "checkpoints" / "pretrain")
        subprocess.run(_command("pretrain", cut), check=True, capture_output=True)
        digests = {_weights(out) for out in (whole, cut)}
    yield at_least(f"killed and gone on with on {device}: the same bits", float(len(digests) == 1), "", 1.0)


def _command(stage: str, out: Path) -> list[str]:
    overrides = (
        "cameras={height: 32, width: 32}",
        "generate={episodes: 4, fps: 10, seconds: 2, renderer: solids}",
        "policy={name: act, chunk: 5, dim: 32, ffn: 64, vae_layers: 1, trunk_width: 8}",
        "pretrain={epochs: 60, batch_size: 4, precision: fp32, resume_seconds: 0, probe_episodes: 0}",
    )
    flags = [flag for override in overrides for flag in ("--set", override)]
    return [sys.executable, "-m", "geoprior", stage, "lite", "--out", str(out), *flags]


def _kill_on_the_way(command: list[str], folder: Path) -> None:
    """SIGKILL once the first state is saved; a training that is through before that is left alone."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + _PATIENCE
        while process.poll() is None and time.monotonic() < deadline:
            if list(folder.glob("resume*")):
                time.sleep(_KILL_AFTER)
                os.kill(process.pid, signal.SIGKILL)
                return
            time.sleep(0.02)


def _weights(run: Path) -> str:
    return sha256_file(list_checkpoints(run / "checkpoints" / "pretrain")[-1].path)
