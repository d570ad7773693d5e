"""Differences of paired outcomes, as ``results.json`` has them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geoprior.study.schema import Bounds, Difference
from geoprior.study.statistics import Interval, curve_weights, paired_interval

Outcomes = dict[int, NDArray[np.bool_]]
"""By epoch: (training seeds, initial states), both by rising seed."""


def area_table(outcomes: Outcomes, epochs: Sequence[int]) -> NDArray[np.float64]:
    """Area under the learning curve over some epochs, by training seed and initial state."""
    curve = np.stack([outcomes[epoch] for epoch in epochs])
    table: NDArray[np.float64] = np.tensordot(curve_weights(epochs), curve, axes=1)
    return table


def difference(table: NDArray[np.float64], rng: np.random.Generator) -> Difference:
    """The mean of paired differences and its interval."""
    table = np.clip(table, -1.0, 1.0)
    return Difference(difference=rounded(float(table.mean())), interval=bounds(paired_interval(table, rng)))


def bounds(interval: Interval) -> Bounds:
    """An interval as the file has it."""
    return Bounds(low=rounded(interval.low), high=rounded(interval.high))


def rounded(value: float) -> float:
    """Nine digits: what differs between processors stays out of ``results.json``."""
    return round(value, 9) + 0.0
