"""Shares of the prior's gain: right at both ends, honest in between, and none where there is no gain."""

import json
from itertools import product

import numpy as np
import pytest

from geoprior.geometry.seeding import generator
from geoprior.sim.records import TrialRecord
from geoprior.study.results import parse_results, summarise
from geoprior.study.shares import controls_of
from geoprior.study.statistics import share_interval
from geoprior.training.config import ConditionConfig

EPOCHS = (128, 256)


def outcome(rate, *, states=60, training_seeds=(0, 1, 2, 3, 4), seed=0):
    """Whether each trial succeeds; conditions of one seed are paired by how hard a state is."""
    luck = np.random.default_rng(seed).random((len(EPOCHS), len(training_seeds), states))
    return luck < rate


def trials(conditions):
    """Of made-up outcomes (epochs, training seeds, states) by condition."""
    return [
        TrialRecord(
            task="pick",
            robot="ur5e",
            condition=name,
            training_seed=training_seed,
            epoch=epoch,
            state_seed=1000 + state,
            success=bool(table[place, training_seed, state]),
            reason="" if table[place, training_seed, state] else "dropped",
            steps=10,
            seconds=1.0,
        )
        for name, table in conditions.items()
        for (place, epoch), training_seed, state in product(
            enumerate(EPOCHS), range(table.shape[1]), range(table.shape[2])
        )
    ]


def shares(conditions, **options):
    group = summarise(trials(conditions), seed=0, **options).groups[0]
    return {share.condition: share for share in group.gain_shares}, group


def test_what_equals_the_prior_has_all_of_it_and_what_equals_scratch_nothing():
    good, bad = outcome(0.7), outcome(0.1)
    found, _ = shares({"scratch": bad, "prior": good, "twin": good, "nothing": bad})
    assert list(found) == ["prior", "nothing", "twin"]
    for name in ("prior", "twin"):
        assert found[name].share == 1.0
        assert (found[name].interval.low, found[name].interval.high) == (1.0, 1.0)
    assert found["nothing"].share == 0.0
    assert found["nothing"].interval.low < 0.0 < found["nothing"].interval.high
    assert found["nothing"].interval.high < 0.15


def test_a_share_is_the_ratio_of_the_differences_that_the_comparisons_have():
    found, group = shares({"scratch": outcome(0.1), "prior": outcome(0.7), "half": outcome(0.4)})
    gains = {each.condition: each.area_under_curve for each in group.comparisons}
    for name in ("prior", "half"):
        assert found[name].gain == gains[name]
        ratio = gains[name].difference / gains["prior"].difference
        assert found[name].share == pytest.approx(ratio, abs=1e-8)
    areas = {each.name: each.area_under_curve for each in group.conditions}
    assert found["half"].area_under_curve == pytest.approx(areas["half"], abs=1e-8)
    assert found["half"].interval.low < 0.5 < found["half"].interval.high
    assert found["half"].interval.low > 0.2
    assert found["half"].interval.high < 0.8


def test_of_a_gain_that_is_not_clear_nobody_has_a_share():
    found, _ = shares({"scratch": outcome(0.4), "prior": outcome(0.41, seed=1), "half": outcome(0.4, seed=2)})
    assert all(share.share is None and share.interval is None for share in found.values())
    lost, _ = shares({"scratch": outcome(0.7), "prior": outcome(0.1), "half": outcome(0.4)})
    assert lost["half"].share is None


def test_there_is_no_table_without_a_control_a_prior_or_a_baseline():
    good, bad = outcome(0.7), outcome(0.1)
    assert shares({"scratch": bad, "prior": good})[0] == {}
    assert shares({"scratch": bad, "blind": good})[0] == {}
    assert shares({"prior": bad, "blind": good})[0] == {}


def test_controls_change_no_other_number_and_go_through_json():
    conditions = {"scratch": outcome(0.1), "prior": outcome(0.7)}
    _, before = shares(conditions)
    _, after = shares({**conditions, "blind": outcome(0.3)}, controls={"blind": "blind"})
    assert before.comparisons[0] in after.comparisons
    results = summarise(trials({**conditions, "blind": outcome(0.3)}), seed=0)
    assert parse_results(json.loads(results.model_dump_json())) == results


def test_results_of_an_earlier_version_are_read():
    tree = summarise(trials({"scratch": outcome(0.1), "prior": outcome(0.7)}), seed=0).model_dump(mode="json")
    del tree["groups"][0]["gain_shares"]
    assert parse_results(tree).groups[0].gain_shares == []


def test_what_a_condition_controls():
    conditions = {
        "scratch": ConditionConfig(init="scratch"),
        "prior": ConditionConfig(init="prior", statistics="pretrained"),
        "blind": ConditionConfig(init="blind-prior", statistics="pretrained"),
        "numbers": ConditionConfig(init="scratch", statistics="pretrained"),
        "image": ConditionConfig(init="imagenet"),
    }
    controls = controls_of(conditions)
    assert controls == {
        "scratch": "other",
        "prior": "other",
        "blind": "blind",
        "numbers": "statistics",
        "image": "other",
    }
    tables = {name: outcome(0.1 * place) for place, name in enumerate(conditions, start=1)}
    found, _ = shares({**tables, "prior": outcome(0.9)}, controls=controls)
    assert {name: share.control for name, share in found.items()} == {name: controls[name] for name in found}


def test_the_interval_holds_the_true_share_about_as_often_as_it_says():
    """A control with 40 % of a gain of 50 points, five trainings whose own luck differs, 40 states."""
    held, studies = 0, 200
    for study in range(studies):
        rng = np.random.default_rng(study)
        luck = rng.normal(0.0, 0.06, (3, 5, 1))
        scratch, control, prior = rng.random((3, 5, 40)) < np.array([0.2, 0.4, 0.7])[:, None, None] + luck
        interval = share_interval(
            control.astype(float) - scratch,
            prior.astype(float) - scratch,
            generator(study, "share"),
            samples=1000,
        )
        held += interval is not None and interval.low <= 0.4 <= interval.high
    assert held / studies > 0.9


def test_a_whole_that_may_be_nothing_gives_no_interval():
    rng = np.random.default_rng(0)
    whole = np.where(rng.random((1, 40)) < 0.5, 1.0, -1.0)
    whole[0, :3] = 1.0
    if whole.mean() <= 0.0:
        whole = -whole
    assert share_interval(np.zeros((1, 40)), whole, generator(0, "share")) is None


@pytest.mark.parametrize(
    ("gains", "whole"), [(np.zeros((1, 4)), np.ones((1, 5))), (np.zeros((1, 4)), np.zeros((1, 4)))]
)
def test_shares_of_nothing_are_refused(gains, whole):
    with pytest.raises(ValueError, match="a share needs gains on the same pairs"):
        share_interval(gains, whole, generator(0, "share"))
