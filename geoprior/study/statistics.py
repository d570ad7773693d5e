"""Success rates, differences and learning curves, and how sure one may be of them.

docs/statistics.md says which of these numbers answers which question.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import binom, binomtest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

CONFIDENCE = 0.95
BOOTSTRAP_SAMPLES = 10_000


@dataclass(frozen=True)
class Interval:
    """A confidence interval, both ends included."""

    low: float
    high: float


@dataclass(frozen=True)
class McNemar:
    """Pairs that disagree, and the exact two-sided test that they lean to neither side.

    Attributes:
        first_only: Pairs in which only the first succeeded.
        second_only: Pairs in which only the second succeeded.
        p_value: Of the hypothesis that both kinds are equally likely; 1 when no pair disagrees.
    """

    first_only: int
    second_only: int
    p_value: float


@dataclass(frozen=True)
class Peak:
    """The best checkpoint in hindsight. It reads high: see `expected_peak`.

    Attributes:
        epoch: Of the best checkpoint, the earliest of equals.
        rate: Its success rate, 0 to 1.
    """

    epoch: int
    rate: float


def wilson_interval(successes: int, trials: int, *, confidence: float = CONFIDENCE) -> Interval:
    """Wilson's score interval of a success rate (from `scipy.stats.binomtest`).

    Args:
        successes: Between 0 and ``trials``.
        trials: At least 1, independent of each other.
        confidence: Coverage asked for, between 0 and 1.

    Returns:
        Within [0, 1]; never of width zero, not even at 0 or all successes.

    Raises:
        ValueError: The counts are impossible.
    """
    bounds = binomtest(successes, trials).proportion_ci(confidence_level=confidence, method="wilson")
    return Interval(float(bounds.low), float(bounds.high))


def paired_interval(
    differences: ArrayLike,
    rng: np.random.Generator,
    *,
    samples: int = BOOTSTRAP_SAMPLES,
    confidence: float = CONFIDENCE,
) -> Interval:
    """Bootstrap interval of a mean paired difference, over training seeds and initial states.

    Every training seed meets the same initial states, so the two are crossed, not nested: a resample
    draws training seeds and, once for all of them, initial states, each with replacement (A. Owen, "The
    pigeonhole bootstrap", 2007). With one training seed only the states are drawn, and the interval speaks
    of those trained policies, not of other trainings.

    Two made-up states, half a success to either side, join the real ones, much as Agresti and Min (2005)
    do for paired proportions: without them the interval shrinks to a point when all pairs agree.

    Args:
        differences: (S, N): first minus second, by training seed and initial state, in [-1, 1].
        rng: Decides the resamples; the same generator state gives the same interval.
        samples: Resamples.
        confidence: Coverage asked for, between 0 and 1.

    Returns:
        Percentile interval within [-1, 1], widened where needed to hold the measured mean.

    Raises:
        ValueError: ``differences`` is not a table, is empty, or leaves [-1, 1].
    """
    table = _difference_table(differences)
    seeds, states = table.shape
    padded = np.concatenate([table, np.full((seeds, 1), 0.5), np.full((seeds, 1), -0.5)], axis=1)
    seed_counts = _resample_counts(seeds, samples, rng)
    state_counts = _resample_counts(states + 2, samples, rng)
    means = np.sum((seed_counts @ padded) * state_counts, axis=1) / padded.size
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(means, [tail, 1.0 - tail])
    mean = float(table.mean())
    return Interval(min(float(low), mean), max(float(high), mean))


def mcnemar_exact(first: ArrayLike, second: ArrayLike) -> McNemar:
    """McNemar's exact test on paired outcomes (a binomial test of the pairs that disagree).

    Args:
        first: Outcomes, bool, any shape.
        second: Outcomes on the same initial states, of the same shape.

    Raises:
        ValueError: The shapes differ: the outcomes are not paired.
    """
    one, two = np.asarray(first, dtype=bool), np.asarray(second, dtype=bool)
    if one.shape != two.shape:
        raise ValueError(f"paired outcomes must have one shape, found {one.shape} and {two.shape}")
    first_only, second_only = int(np.sum(one & ~two)), int(np.sum(two & ~one))
    disagreeing = first_only + second_only
    p_value = float(binomtest(first_only, disagreeing, 0.5).pvalue) if disagreeing else 1.0
    return McNemar(first_only, second_only, p_value)


def curve_weights(epochs: Sequence[int]) -> NDArray[np.float64]:
    """Weights (K,) with which K checkpoints enter the area under a learning curve; they sum to 1.

    The trapezoidal rule from the first to the last checkpoint, divided by that span.

    Raises:
        ValueError: There is no epoch, or they do not rise.
    """
    if not epochs:
        raise ValueError("a learning curve needs at least one checkpoint")
    if len(epochs) == 1:
        return np.ones(1)
    steps = np.diff(np.asarray(epochs, dtype=np.float64))
    if np.any(steps <= 0):
        raise ValueError(f"epochs must rise, found {list(epochs)}")
    weights: NDArray[np.float64] = (np.append(steps, 0.0) + np.append(0.0, steps)) / (2.0 * steps.sum())
    return weights


def area_under_curve(epochs: Sequence[int], rates: Sequence[float]) -> float:
    """Mean success rate between the first and the last checkpoint, 0 to 1; see `curve_weights`."""
    return math.fsum(curve_weights(epochs) * np.asarray(rates, dtype=np.float64))


def find_peak(epochs: Sequence[int], rates: Sequence[float]) -> Peak:
    """The best checkpoint in hindsight, the earliest of equals."""
    best = int(np.argmax(rates))
    return Peak(int(epochs[best]), float(rates[best]))


def expected_peak(rate: float, *, checkpoints: int, trials: int) -> float:
    """What the peak reads on average when every checkpoint in truth has the same success rate.

    The expected maximum of independent binomial rates: the optimism of choosing in hindsight.

    Args:
        rate: True success rate of every checkpoint, 0 to 1.
        checkpoints: How many one chooses from, at least 1.
        trials: Of each checkpoint, at least 1.

    Returns:
        Between ``rate`` and 1.
    """
    below = binom.cdf(np.arange(trials), trials, rate)
    return float(np.sum(1.0 - below**checkpoints) / trials)


def _difference_table(differences: ArrayLike) -> NDArray[np.float64]:
    table = np.asarray(differences, dtype=np.float64)
    if table.ndim != 2 or table.size == 0:
        raise ValueError(f"expected (training seeds, initial states), found shape {table.shape}")
    if not np.all(np.abs(table) <= 1.0):
        raise ValueError("differences of success must lie in [-1, 1]")
    return table


def _resample_counts(size: int, samples: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(samples, size): how often each of ``size`` things is drawn in ``size`` draws."""
    counts: NDArray[np.int64] = rng.multinomial(size, np.full(size, 1.0 / size), size=samples)
    return counts.astype(np.float64)
