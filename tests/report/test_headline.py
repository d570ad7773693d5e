"""The sentence at the top says what the numbers say, for whoever is ahead."""

import pytest
from report_material import trials

from geoprior.report.headline import caution, explanation, headline, readings
from geoprior.study.results import summarise


def group_of(rates, **kwargs):
    return summarise(trials(rates, **kwargs), seed=0).groups[0]


def flat(rate):
    return {256: rate, 512: rate}


@pytest.mark.parametrize(
    ("prior", "scratch", "verdict"),
    [
        (0.8, 0.1, "the prior is ahead"),
        (0.1, 0.8, "scratch is ahead"),
        (0.5, 0.5, "no clear difference"),
        (0.0, 0.0, "no clear difference"),
    ],
)
def test_the_headline_says_who_is_ahead_if_anybody_is(prior, scratch, verdict):
    group = group_of({"prior": flat(prior), "scratch": flat(scratch)})
    text = headline(group)
    assert text.endswith(f": {verdict}")
    for condition, name in zip(group.conditions, ("From the prior", "from scratch"), strict=True):
        assert f"{name} {round(100 * condition.area_under_curve)}\u202f%" in text


def test_an_interval_that_holds_zero_is_no_clear_difference():
    """A few points ahead on thirty states is nothing."""
    group = group_of({"prior": flat(0.52), "scratch": flat(0.47)}, seed=3)
    area = group.comparisons[0].area_under_curve
    assert area.difference != 0.0
    assert area.interval.low <= 0.0 <= area.interval.high
    assert headline(group).endswith("no clear difference")


def test_the_readings_are_the_checkpoints_fixed_in_advance():
    group = group_of({"prior": {256: 0.9, 512: 0.2, 768: 0.5}, "scratch": {256: 0.0, 512: 0.9, 768: 0.5}})
    found = readings(group)
    assert [reading.title for reading in found] == ["First checkpoint", "Whole curve", "Last checkpoint"]
    assert [reading.detail for reading in found] == [
        "256 epochs",
        "mean from 256 to 768 epochs",
        "768 epochs",
    ]
    assert found[0].clear
    assert found[0].rates[1] == ("scratch", "0\u202f%")


def test_one_checkpoint_gives_one_reading():
    group = group_of({"prior": {256: 0.9}, "scratch": {256: 0.0}})
    assert [reading.detail for reading in readings(group)] == ["256 epochs"]
    assert "after 256 fine-tuning epochs" in explanation(group, 0.95)


def test_rates_and_difference_are_over_the_same_epochs():
    """A condition measured longer is compared where both were measured."""
    group = group_of({"prior": {256: 0.5, 512: 0.5}, "scratch": {256: 0.5, 512: 0.5, 1024: 1.0}}, seed=1)
    whole = readings(group)[1]
    prior, scratch = (int(rate.split("\u202f")[0]) for _, rate in whole.rates)
    difference = 100.0 * group.comparisons[0].area_under_curve.difference
    assert prior - scratch == pytest.approx(difference, abs=1.01)
    assert group.conditions[1].area_under_curve > (scratch + 5) / 100


def test_the_headline_is_about_the_prior_when_there_are_more_conditions():
    group = group_of({"black-images": flat(0.9), "prior": flat(0.5), "scratch": flat(0.1)})
    assert headline(group).startswith("From the prior")


def test_one_condition_alone_is_not_compared():
    group = group_of({"prior": flat(0.9)})
    assert "ahead" not in headline(group)
    assert "nothing to compare" in explanation(group, 0.95)
    assert readings(group) == []


@pytest.mark.parametrize(
    ("seeds", "begins"),
    [((0,), "A demonstration on one training seed, not the evidence."), ((0, 1, 2), "3 ")],
)
def test_few_training_seeds_are_said(seeds, begins):
    assert caution(group_of({"prior": flat(0.5)}, training_seeds=seeds)).startswith(begins)


def test_five_training_seeds_need_no_caution():
    assert caution(group_of({"prior": flat(0.5)}, training_seeds=range(5), states=5)) == ""
