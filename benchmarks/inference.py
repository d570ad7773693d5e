"""How long a policy thinks, alone and for many environments at once."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.clock import seconds_of
from benchmarks.metrics import Metric
from benchmarks.training import COMPACT, LARGE, SEED, SIZE
from geoprior.policies.normalise import FeatureStatistics, Normaliser
from geoprior.policies.policy import Features
from geoprior.policies.predictor import LoadedPredictor
from geoprior.training.stages import build_policy

if TYPE_CHECKING:
    from geoprior.options import Choice

FEATURES = Features(("hand", "third"), (SIZE, SIZE), ("hand",), 25)
ROWS = (1, 4, 16)


def measure() -> Iterator[Metric]:
    """Both sizes, in both precisions, for 1, 4 and 16 observations (half a minute)."""
    yield from _measure(30)


def measure_quickly() -> Iterator[Metric]:
    """The same, three times each."""
    yield from _measure(3)


def _measure(count: int) -> Iterator[Metric]:
    for name, choice in (("compact", COMPACT), ("dim 512", LARGE)):
        for half in (False, True):
            predictor = make_predictor(choice, half=half)
            for rows in ROWS:
                times_of_predictions(predictor, rows, 3)
                took = median(times_of_predictions(predictor, rows, count))
                of = f"{name}, {'bf16' if half else 'fp32'}, {rows} at once"
                yield Metric(f"{of}: a prediction", 1e3 * took, "ms")
                yield Metric(f"{of}: an observation", 1e3 * took / rows, "ms")


def make_predictor(choice: Choice, *, half: bool) -> LoadedPredictor:
    """A policy with random weights, from raw observations to commands."""
    numbers = FeatureStatistics((0.0,) * 8, (1.0,) * 8, 1)
    normaliser = Normaliser({"pose": numbers, "action": numbers})
    policy = build_policy(choice, FEATURES, SEED)
    return LoadedPredictor(policy, FEATURES, 10.0, normaliser, half=half)


def times_of_predictions(predictor: LoadedPredictor, rows: int, count: int) -> list[float]:
    """Seconds of so many predictions for random observations."""
    rng = np.random.default_rng(0)
    pose = rng.normal(size=(rows, 8)).astype(np.float32)
    shape = (rows, *FEATURES.image_size)
    binary = np.array([0, 255], dtype=np.uint8)
    images = {name: rng.choice(binary, size=shape) for name in FEATURES.cameras}
    return [seconds_of(predictor.predict, pose, images) for _ in range(count)]
