"""What fresh episodes cost: the time to make them, and the time that a trainer waits for them."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.metrics import Metric, at_most
from geoprior.executors.local import SerialExecutor
from geoprior.geometry.camera import CamerasConfig
from geoprior.policies.normalise import Normaliser
from geoprior.shards.reader import EpisodeStore
from geoprior.sources._endless import EndlessSource
from geoprior.sources._stager import Stager, StagerConfig
from geoprior.sources.endless import EndlessConfig
from geoprior.sources.shards import ShardSource
from geoprior.sources.source import SourceContext
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.generate import generate as make_shards
from geoprior.training.config import TrainConfig
from geoprior.training.data import Batches, features_of, statistics_of

_CACHE_BYTES = 2**28
_CHUNK = 25
_FOR_EVER = 10**9
_SIZES = (64, 96, 128)
_WAITING_GOAL = 0.05
_SEED = 30_000


def measure() -> Iterator[Metric]:
    """What the source costs with the quickstart's episodes, at three sizes of frames (some minutes)."""
    yield from _measure(_SIZES, GenerateConfig(), seconds=20.0, goal=_WAITING_GOAL)


def measure_quickly() -> Iterator[Metric]:
    """The smallest size, fewer episodes, a shorter look."""
    yield from _measure(_SIZES[:1], GenerateConfig(episodes=30), seconds=4.0, goal=None)


def _measure(
    sizes: Iterable[int], generate: GenerateConfig, seconds: float, goal: float | None
) -> Iterator[Metric]:
    config = EndlessConfig()
    for size in sizes:
        cameras = CamerasConfig(height=size, width=size)
        costs = measure_staging(generate, cameras, seed=_SEED)
        reading = measure_reading(generate, cameras, seed=_SEED)
        waiting = measure_waiting(generate, cameras, config, seconds=seconds, seed=_SEED)
        sample = costs["staging_ms"] / config.keep + costs["drawing_ms"]
        of = f"{size}x{size}"
        yield Metric(f"{of}: staging an episode", costs["staging_ms"], "ms of a core")
        yield Metric(f"{of}: drawing a time step, both cameras", costs["drawing_ms"], "ms of a core")
        yield Metric(f"{of}: a fresh sample, staging shared by {config.keep}", sample, "ms of a core")
        yield Metric(f"{of}: a sample from shards, not kept", reading["reading_ms"], "ms of a core")
        share = f"{of}: share of time waiting at 150 samples/s"
        waited = waiting["waiting_share"]
        yield Metric(share, waited, "") if goal is None else at_most(share, waited, "", goal)
        yield Metric(f"{of}: longest wait for a batch", waiting["longest_wait_ms"], "ms")
        yield Metric(f"{of}: start, first epoch staged", waiting["start_seconds"], "s")


def measure_waiting(
    generate: GenerateConfig,
    cameras: CamerasConfig,
    config: EndlessConfig,
    *,
    samples_per_second: float = 150.0,
    batch_size: int = 16,
    seconds: float = 20.0,
    seed: int = 0,
) -> dict[str, float]:
    """Measure how long a trainer of a given speed waits for batches, once fresh episodes come steadily.

    The trainer is a sleep of the time that a step would take it: one that shares its cores with the source
    also loses what `measure_staging` tells.

    Args:
        generate: What the episodes are.
        cameras: Lenses and size of the frames.
        config: Of the source.
        samples_per_second: Speed of the trainer.
        batch_size: Samples of a step.
        seconds: How long to measure.
        seed: Root seed.

    Returns:
        ``waiting_share``: of all time. ``longest_wait_ms``: for one batch. ``samples_per_second``: what came
        out. ``start_seconds``: until the statistics of the first epoch are there.
    """
    begun = time.perf_counter()
    with closing(
        EndlessSource(config, SourceContext(Path(), generate, cameras, seed, _CACHE_BYTES))
    ) as source:
        normaliser = Normaliser(statistics_of(source))
        training = TrainConfig(batch_size=batch_size)
        batches = Batches(source, features_of(source, _CHUNK), normaliser, training, seed)
        start_seconds = time.perf_counter() - begun
        steady = 2 * config.keep * len(source) // batch_size
        pause = batch_size / samples_per_second
        waits = _waits(batches, steady, -(-len(source) // batch_size), pause, seconds)
    total = sum(waits) + len(waits) * pause
    return {
        "waiting_share": sum(waits) / total,
        "longest_wait_ms": 1e3 * max(waits),
        "samples_per_second": len(waits) * batch_size / total,
        "start_seconds": start_seconds,
    }


def measure_staging(
    generate: GenerateConfig, cameras: CamerasConfig, *, episodes: int = 90, seed: int = 0
) -> dict[str, float]:
    """Measure the processor time of making episodes in this process.

    Args:
        generate: What the episodes are.
        cameras: Lenses and size of the frames.
        episodes: How many.
        seed: Root seed.

    Returns:
        Medians: ``staging_ms`` of an episode, ``drawing_ms`` of one time step of it in all cameras. A
        sample costs ``staging_ms / keep + drawing_ms``.
    """
    stager = Stager(StagerConfig(generate, cameras, seed, _CACHE_BYTES))
    step = np.array([[generate.steps // 2]])
    stager.moments([0], [episodes], step)  # compiles
    staging, drawing = [], []
    for episode in range(episodes):
        begun = time.process_time()
        stager.trajectories([episode], [episode])
        staged = time.process_time()
        stager.moments([episode], [episode], step)
        staging.append(staged - begun)
        drawing.append(time.process_time() - staged)
    return {"staging_ms": 1e3 * median(staging), "drawing_ms": 1e3 * median(drawing)}


def measure_reading(
    generate: GenerateConfig, cameras: CamerasConfig, *, moments: int = 500, seed: int = 0
) -> dict[str, float]:
    """Measure the processor time of reading single time steps from shards that are in the page cache.

    Args:
        generate: What the episodes are; some of them are written to a folder that is thrown away.
        cameras: Lenses and size of the frames.
        moments: How many to read.
        seed: Root seed.

    Returns:
        ``reading_ms``: median of a time step in all cameras.
    """
    some = generate.model_copy(update={"episodes": min(generate.episodes, 10)})
    rng = np.random.default_rng(seed)
    times = []
    with tempfile.TemporaryDirectory() as folder:
        make_shards(some, cameras, seed=seed, executor=SerialExecutor(), out=Path(folder))
        source = ShardSource(EpisodeStore(Path(folder)))
        for _ in range(moments):
            number, step = rng.integers(len(source), size=1), rng.integers(generate.steps, size=(1, 1))
            begun = time.process_time()
            source.read(number, step)
            times.append(time.process_time() - begun)
    return {"reading_ms": 1e3 * median(times)}


def _waits(batches: Batches, first: int, warm_up: int, pause: float, seconds: float) -> list[float]:
    """Seconds of waiting for each batch from step ``first`` on.

    The steps of the epoch before are read without a pause: the episodes that stand there are then staged.
    """
    waits: list[float] = []
    with closing(batches.stream(max(0, first - warm_up), _FOR_EVER)) as stream:
        for _ in range(min(first, warm_up)):
            next(stream)
        end = time.perf_counter() + seconds
        while not waits or time.perf_counter() < end:
            time.sleep(pause)
            begun = time.perf_counter()
            next(stream)
            waits.append(time.perf_counter() - begun)
    return waits
