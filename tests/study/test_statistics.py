"""What a rate, a difference and a curve may be trusted for."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import trapezoid
from scipy.stats import binom, binomtest, norm

from geoprior.geometry.seeding import generator
from geoprior.study.statistics import (
    area_under_curve,
    curve_weights,
    expected_peak,
    find_peak,
    mcnemar_exact,
    paired_interval,
    rate_interval,
    wilson_interval,
)

counts = st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


def wilson_by_hand(successes: int, trials: int, confidence: float) -> tuple[float, float]:
    """The roots of |p - rate| = z * sqrt(p (1 - p) / n), solved as a quadratic."""
    z2 = norm.ppf(0.5 + confidence / 2.0) ** 2
    rate = successes / trials
    roots = np.roots([1.0 + z2 / trials, -(2.0 * rate + z2 / trials), rate**2])
    return tuple(np.sort(roots.real))


@given(counts, st.sampled_from([0.8, 0.95, 0.99]))
def test_wilson_solves_the_score_equation(count, confidence):
    interval = wilson_interval(count[0] / count[1], count[1], confidence=confidence)
    assert_allclose([interval.low, interval.high], wilson_by_hand(*count, confidence), atol=1e-6)


@given(counts)
def test_wilson_holds_the_rate_and_has_width_even_at_the_ends(count):
    successes, trials = count
    interval = wilson_interval(successes / trials, trials)
    assert 0.0 <= interval.low <= successes / trials <= interval.high <= 1.0
    assert interval.high - interval.low > 1e-3


@given(counts)
def test_wilson_mirrors_failures_and_rises_with_successes(count):
    successes, trials = count
    rate = successes / trials
    here, mirrored = wilson_interval(rate, trials), wilson_interval(1.0 - rate, trials)
    assert_allclose([here.low, here.high], [1.0 - mirrored.high, 1.0 - mirrored.low], atol=1e-12)
    if successes < trials:
        more = wilson_interval((successes + 1) / trials, trials)
        assert more.low > here.low
        assert more.high >= here.high


@pytest.mark.parametrize(("trials", "half_width"), [(20, 0.20), (50, 0.13), (100, 0.10), (200, 0.07)])
def test_wilson_half_widths_that_the_documentation_quotes(trials, half_width):
    interval = wilson_interval(0.5, trials)
    assert (interval.high - interval.low) / 2.0 == pytest.approx(half_width, abs=0.005)


@pytest.mark.parametrize("rate", [0.05, 0.3, 0.5, 0.9])
@pytest.mark.parametrize("trials", [30, 50, 150])
def test_wilson_covers_about_as_often_as_it_says(rate, trials):
    chance = binom.pmf(np.arange(trials + 1), trials, rate)
    intervals = [wilson_interval(k / trials, trials) for k in range(trials + 1)]
    covered = sum(p for p, found in zip(chance, intervals, strict=True) if found.low <= rate <= found.high)
    assert covered > 0.92


@pytest.mark.parametrize(("rate", "trials"), [(-0.1, 10), (1.1, 10), (0.5, 0)])
def test_wilson_refuses_impossible_rates(rate, trials):
    with pytest.raises(ValueError, match="impossible"):
        wilson_interval(rate, trials)


@given(counts, st.sampled_from([0.8, 0.95, 0.99]))
def test_wilson_is_scipys(count, confidence):
    found = wilson_interval(count[0] / count[1], count[1], confidence=confidence)
    theirs = binomtest(*count).proportion_ci(confidence_level=confidence, method="wilson")
    assert_allclose([found.low, found.high], [theirs.low, theirs.high], atol=1e-12)


def test_one_training_has_wilsons_interval():
    row = np.arange(40) % 3 == 0
    assert rate_interval(row[None]) == wilson_interval(row.mean(), 40)


def test_trainings_that_agree_on_every_state_are_worth_one():
    row = np.arange(40) % 3 == 0
    agreeing = rate_interval(np.tile(row, (5, 1)))
    assert_allclose(vars(agreeing)["low"], rate_interval(row[None]).low, rtol=0.05)
    assert rate_interval(np.ones((5, 40))) == wilson_interval(1.0, 40)


@pytest.mark.parametrize("state_spread", [0.0, 1.0, 4.0])
@pytest.mark.parametrize("seeds", [2, 5])
def test_a_pooled_rate_covers_the_rate_of_the_same_policies_on_other_states(seeds, state_spread):
    rng = np.random.default_rng(5)
    luck = 0.7 * rng.normal(size=(seeds, 1))

    def rates(states):
        return 1.0 / (1.0 + np.exp(-luck - state_spread * rng.normal(size=(1, states))))

    truth, covered = rates(200_000).mean(), 0
    for _ in range(300):
        chance = rates(50)
        found = rate_interval(rng.random(chance.shape) < chance)
        covered += found.low <= truth <= found.high
    assert covered / 300 > 0.92


def test_mcnemar_against_the_binomial_sum():
    first = np.array([1] * 20 + [1] * 9 + [0] * 2 + [0] * 19, dtype=bool)
    second = np.array([1] * 20 + [0] * 9 + [1] * 2 + [0] * 19, dtype=bool)
    found = mcnemar_exact(first, second)
    assert (found.first_only, found.second_only) == (9, 2)
    assert found.p_value == pytest.approx(2.0 * sum(math.comb(11, k) for k in range(3)) / 2**11)


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=60))
def test_mcnemar_takes_no_side_and_ignores_pairs_that_agree(pairs):
    first, second = np.array(pairs).T
    one, other = mcnemar_exact(first, second), mcnemar_exact(second, first)
    assert one.p_value == pytest.approx(other.p_value)
    assert (one.first_only, one.second_only) == (other.second_only, other.first_only)
    agreeing = mcnemar_exact(np.append(first, [True, False]), np.append(second, [True, False]))
    assert agreeing == one
    assert mcnemar_exact(first, first).p_value == 1.0


def test_mcnemar_is_honest_when_nothing_differs():
    rng = np.random.default_rng(0)
    rejected = 0
    for _ in range(400):
        difficulty = rng.random(30)
        first, second = rng.random(30) < difficulty, rng.random(30) < difficulty
        rejected += mcnemar_exact(first, second).p_value < 0.05
    assert rejected / 400 < 0.06


def test_mcnemar_refuses_what_is_not_paired():
    with pytest.raises(ValueError, match="one shape"):
        mcnemar_exact([True, False], [True])


def outcomes(rng, seeds, states, *, shift, seed_spread=0.0, state_spread=1.0, taste=0.0):
    """Outcomes of two conditions whose training seeds and initial states differ in luck (log-odds)."""
    state = state_spread * rng.normal(size=(1, states))
    first = (
        shift / 2 + seed_spread * rng.normal(size=(seeds, 1)) + state + taste * rng.normal(size=(1, states))
    )
    second = -shift / 2 + seed_spread * rng.normal(size=(seeds, 1)) + state
    rates = [1.0 / (1.0 + np.exp(-odds)) for odds in (first, second)]
    return rates, [rng.random(rate.shape) < rate for rate in rates]


@pytest.mark.parametrize(
    ("seeds", "states", "spread"),
    [
        (1, 30, {"shift": 1.0}),
        (1, 30, {"shift": 6.0, "state_spread": 0.5}),
        (3, 50, {"shift": 1.0, "seed_spread": 0.5, "taste": 1.0}),
        (3, 50, {"shift": 0.5, "state_spread": 2.0, "taste": 3.0}),
        (5, 30, {"shift": 0.0, "seed_spread": 0.3}),
    ],
)
def test_paired_interval_covers_the_true_difference(seeds, states, spread):
    rng = np.random.default_rng(1)
    rates, _ = outcomes(rng, 1500, 1500, **spread)
    truth = (rates[0] - rates[1]).mean()
    covered = 0
    for _ in range(200):
        _, (first, second) = outcomes(rng, seeds, states, **spread)
        found = paired_interval(first.astype(float) - second, rng, samples=500)
        covered += found.low <= truth <= found.high
    assert covered / 200 > 0.9


@pytest.mark.parametrize("seeds", [2, 3, 5])
@pytest.mark.parametrize("seed_spread", [0.0, 0.5, 1.3])
def test_the_area_of_few_trainings_that_stay_apart_is_covered(seeds, seed_spread):
    """Over a whole curve a training's own luck stays, and that of single trials averages out."""
    rng, checkpoints, covered = np.random.default_rng(4), 6, 0

    def rates(shape):
        luck = seed_spread * rng.normal(size=(2, shape[0], 1))
        odds = np.array([0.5, -0.5])[:, None, None] + luck + rng.normal(size=(1, 1, shape[1]))
        return 1.0 / (1.0 + np.exp(-odds))

    first, second = rates((2000, 2000))
    truth = (first - second).mean()
    for _ in range(200):
        chance = np.repeat(rates((seeds, 50))[..., None], checkpoints, axis=-1)
        first, second = (rng.random(chance.shape) < chance).mean(axis=-1)
        found = paired_interval(first - second, rng, samples=500)
        covered += found.low <= truth <= found.high
    assert covered / 200 > 0.9


def test_pairing_beats_comparing_two_rates():
    rng = np.random.default_rng(2)
    _, (first, second) = outcomes(rng, 1, 200, shift=0.5, state_spread=4.0)
    paired = paired_interval(first.astype(float) - second, rng)
    shuffled = rng.permuted(second, axis=1)
    unpaired = paired_interval(first.astype(float) - shuffled, rng)
    assert paired.high - paired.low < 0.75 * (unpaired.high - unpaired.low)


def test_states_are_drawn_once_for_all_seeds():
    """Three trainings that agree on every state know no more about the states than one does."""
    row = np.repeat([[1.0, 0.0, 0.0, -1.0]], 10, axis=0).reshape(1, 40)
    one = paired_interval(row, generator(0, "one"))
    three = paired_interval(np.repeat(row, 3, axis=0), generator(0, "three"))
    assert three.high - three.low == pytest.approx(one.high - one.low, rel=0.05)


def test_training_seeds_that_disagree_widen_the_interval():
    agreeing = np.tile([1.0, 0.0], (4, 20))
    disagreeing = np.repeat([[1.0], [0.0], [1.0], [0.0]], 40, axis=1)
    assert agreeing.mean() == disagreeing.mean()
    calm, torn = paired_interval(agreeing, generator(0)), paired_interval(disagreeing, generator(0))
    assert torn.high - torn.low > 2.0 * (calm.high - calm.low)


@pytest.mark.parametrize("value", [-1.0, 0.0, 1.0])
def test_agreement_of_all_pairs_is_not_certainty(value):
    found = paired_interval(np.full((1, 30), value), generator(0))
    assert found.low <= value <= found.high
    assert 0.02 < found.high - found.low < 0.2


def test_more_states_narrow_the_interval():
    row = np.tile([1.0, 0.0, 0.0, 1.0, -1.0], 8)
    widths = [
        found.high - found.low
        for repeats in (1, 2, 8)
        if (found := paired_interval(np.tile(row, repeats)[None], generator(0)))
    ]
    assert widths == sorted(widths, reverse=True)
    assert widths[0] / widths[2] == pytest.approx(math.sqrt(8), rel=0.15)


@given(st.integers(1, 4), st.integers(1, 20), st.integers(0, 2**32))
def test_paired_interval_is_a_function_of_its_arguments(seeds, states, seed):
    table = np.random.default_rng(seed).choice([-1.0, 0.0, 1.0], size=(seeds, states))
    once, again = (paired_interval(table, generator(seed, "bootstrap"), samples=300) for _ in range(2))
    assert once == again
    assert -1.0 <= once.low <= table.mean() <= once.high <= 1.0


def test_paired_interval_favours_no_side():
    table = np.random.default_rng(4).choice([-1.0, 0.0, 1.0], p=[0.1, 0.5, 0.4], size=(3, 50))
    one, other = paired_interval(table, generator(0)), paired_interval(-table, generator(1))
    assert one.low == pytest.approx(-other.high, abs=0.01)
    assert one.high == pytest.approx(-other.low, abs=0.01)


@pytest.mark.parametrize("table", [np.zeros(3), np.zeros((0, 3)), np.array([[2.0]]), np.array([[np.nan]])])
def test_paired_interval_refuses_what_is_no_table_of_differences(table):
    with pytest.raises(ValueError, match=r"shape|\[-1, 1\]"):
        paired_interval(table, generator(0))


@given(st.lists(st.integers(0, 5000), min_size=1, max_size=12, unique=True), st.data())
def test_area_is_numpys_trapezoid_over_the_span(epochs, data):
    epochs = sorted(epochs)
    rates = data.draw(st.lists(st.floats(0, 1), min_size=len(epochs), max_size=len(epochs)))
    assert curve_weights(epochs).sum() == pytest.approx(1.0)
    found = area_under_curve(epochs, rates)
    assert min(rates) - 1e-12 <= found <= max(rates) + 1e-12
    if len(epochs) > 1:
        assert found == pytest.approx(trapezoid(rates, epochs) / (epochs[-1] - epochs[0]))


def test_area_of_one_checkpoint_is_its_rate():
    assert area_under_curve([256], [0.63]) == pytest.approx(0.63)


@pytest.mark.parametrize("epochs", [[], [5, 5], [5, 3]])
def test_area_refuses_epochs_that_do_not_rise(epochs):
    with pytest.raises(ValueError, match=r"checkpoint|rise"):
        curve_weights(epochs)


def test_peak_is_the_earliest_of_equals():
    peak = find_peak([10, 20, 30], [0.2, 0.6, 0.6])
    assert (peak.epoch, peak.rate) == (20, 0.6)


@pytest.mark.parametrize(("checkpoints", "trials"), [(1, 30), (4, 30), (10, 50), (30, 50)])
def test_expected_peak_against_simulation(checkpoints, trials):
    rng = np.random.default_rng(3)
    simulated = rng.binomial(trials, 0.5, size=(4000, checkpoints)).max(axis=1).mean() / trials
    assert expected_peak(0.5, checkpoints=checkpoints, trials=trials) == pytest.approx(simulated, abs=0.006)


def test_the_peak_of_a_paper_sized_study_reads_far_above_the_truth():
    assert expected_peak(0.5, checkpoints=1, trials=50) == pytest.approx(0.5)
    assert 0.63 < expected_peak(0.5, checkpoints=30, trials=50) < 0.67
    assert expected_peak(0.0, checkpoints=30, trials=50) == 0.0
    assert expected_peak(1.0, checkpoints=30, trials=50) == pytest.approx(1.0)
