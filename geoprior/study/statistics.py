"""Success rates, differences and learning curves, and how sure one may be of them.

docs/statistics.md says which of these numbers answers which question.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import binom, binomtest, norm, t

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


def wilson_interval(rate: float, trials: float, *, confidence: float = CONFIDENCE) -> Interval:
    """Wilson's score interval of a success rate (E. B. Wilson, 1927).

    `scipy.stats.binomtest` has it for whole numbers of trials; the two agree there.

    Args:
        rate: Measured, 0 to 1.
        trials: Independent ones that it is worth, at least 1; perhaps not a whole number.
        confidence: Coverage asked for, between 0 and 1.

    Returns:
        Within [0, 1]; never of width zero, not even at a rate of 0 or 1.

    Raises:
        ValueError: The numbers are impossible.
    """
    if not 0.0 <= rate <= 1.0 or trials < 1:
        raise ValueError(f"a rate of {rate} in {trials} trials is impossible")
    z = float(norm.ppf((1.0 + confidence) / 2.0))
    shrunk = 1.0 + z**2 / trials
    centre = (rate + z**2 / (2.0 * trials)) / shrunk
    half_width = z / shrunk * math.sqrt(rate * (1.0 - rate) / trials + z**2 / (4.0 * trials**2))
    return Interval(min(max(0.0, centre - half_width), rate), max(min(1.0, centre + half_width), rate))


def rate_interval(outcomes: ArrayLike, *, confidence: float = CONFIDENCE) -> Interval:
    """Wilson's interval of the success rate of trained policies, over the initial states.

    Policies of several training seeds meet the same states, and what one fails on the others may fail on
    too. So their trials are worth fewer than they are: as many as would give the mean over states the
    variance that it shows, at least one a state. Of other trainings the interval does not speak.

    Args:
        outcomes: (S, N) bool, by training seed and initial state.
        confidence: Coverage asked for, between 0 and 1.
    """
    table = np.asarray(outcomes, dtype=np.float64)
    seeds, states = table.shape
    rate = float(table.mean())
    variance = float(table.mean(axis=0).var(ddof=1)) / states if states > 1 else 0.0
    worth = rate * (1.0 - rate) / variance if variance > 0.0 else states
    return wilson_interval(rate, min(max(worth, states), seeds * states), confidence=confidence)


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

    Drawing from few seeds shows too little of how trainings differ: from two, nothing lies beyond the worse
    one. So what the draw of seeds moves is stretched, by Student's quantile for so many seeds over the normal
    one and by the square root of S / (S - 1); benchmarks/interval_coverage.py has what that does.

    Two made-up states, half a success to either side, join the real ones, much as Agresti and Min (2005)
    do for paired proportions: without them the interval shrinks to a point when all pairs agree.

    Args:
        differences: (S, N): first minus second, by training seed and initial state, in [-1, 1].
        rng: Decides the resamples; the same generator state gives the same interval.
        samples: Resamples.
        confidence: Coverage asked for, between 0 and 1.

    Returns:
        Within [-1, 1], widened where needed to hold the measured mean.

    Raises:
        ValueError: ``differences`` is not a table, is empty, or leaves [-1, 1].
    """
    table = _difference_table(differences)
    (means,) = _resampled_means([table], rng, samples, confidence)
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(means, [tail, 1.0 - tail])
    mean = float(table.mean())
    return Interval(min(max(float(low), -1.0), mean), max(min(float(high), 1.0), mean))


def share_interval(
    gains: ArrayLike,
    whole: ArrayLike,
    rng: np.random.Generator,
    *,
    samples: int = BOOTSTRAP_SAMPLES,
    confidence: float = CONFIDENCE,
) -> Interval | None:
    """Bootstrap interval of a ratio of mean gains, such as a control's share of the prior's gain.

    The resamples are `paired_interval`'s, the same trainings and states for both gains: what they share by
    luck cancels. A resample in which the whole gain is not above zero has no share; it counts as one beyond
    either end.

    Args:
        gains: (S, N): by training seed and initial state, in [-1, 1].
        whole: (S, N): the gain that it is a share of; its mean is above zero.
        rng: Decides the resamples.
        samples: Resamples.
        confidence: Coverage asked for, between 0 and 1.

    Returns:
        Widened where needed to hold the measured share; None where too many resamples have none.

    Raises:
        ValueError: The tables differ in shape, are empty or leave [-1, 1], or the whole is not above zero.
    """
    part, total = _difference_table(gains), _difference_table(whole)
    if part.shape != total.shape or total.mean() <= 0.0:
        raise ValueError("a share needs gains on the same pairs, of a whole that is above zero")
    above, below = _resampled_means([part, total], rng, samples, confidence)
    shares = np.divide(above, below, out=np.full(samples, np.inf), where=below > 0.0)
    tail = (1.0 - confidence) / 2.0
    high = float(np.quantile(shares, 1.0 - tail, method="higher"))
    low = float(np.quantile(np.where(below > 0.0, shares, -np.inf), tail, method="lower"))
    if not (math.isfinite(low) and math.isfinite(high)):
        return None
    share = float(part.mean() / total.mean())
    return Interval(min(low, share), max(high, share))


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


def _stretch(seeds: int, confidence: float) -> float:
    """By how much a mean of so many is less certain than a draw from them with replacement shows."""
    if seeds == 1:
        return 1.0
    quantile = (1.0 + confidence) / 2.0
    return float(t.ppf(quantile, seeds - 1) / norm.ppf(quantile)) * math.sqrt(seeds / (seeds - 1))


def _difference_table(differences: ArrayLike) -> NDArray[np.float64]:
    table = np.asarray(differences, dtype=np.float64)
    if table.ndim != 2 or table.size == 0:
        raise ValueError(f"expected (training seeds, initial states), found shape {table.shape}")
    if not np.all(np.abs(table) <= 1.0):
        raise ValueError("differences of success must lie in [-1, 1]")
    return table


def _resampled_means(
    tables: Sequence[NDArray[np.float64]], rng: np.random.Generator, samples: int, confidence: float
) -> list[NDArray[np.float64]]:
    """(samples,) means of each table of one shape, over the same draws; see `paired_interval`."""
    seeds, states = tables[0].shape
    seed_counts = _resample_counts(seeds, samples, rng)
    state_counts = _resample_counts(states + 2, samples, rng)
    found = []
    for table in tables:
        padded = np.concatenate([table, np.full((seeds, 1), 0.5), np.full((seeds, 1), -0.5)], axis=1)
        means = np.sum((seed_counts @ padded) * state_counts, axis=1) / padded.size
        of_seeds = padded.mean(axis=1) - padded.mean()
        means += (_stretch(seeds, confidence) - 1.0) * (seed_counts @ of_seeds) / seeds
        found.append(means)
    return found


def _resample_counts(size: int, samples: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(samples, size): how often each of ``size`` things is drawn in ``size`` draws."""
    counts: NDArray[np.int64] = rng.multinomial(size, np.full(size, 1.0 / size), size=samples)
    return counts.astype(np.float64)
