"""results.json: right, complete, and the same whatever the order and the clock."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geoprior.errors import DataError
from geoprior.study.results import TrialRecord, parse_results, read_rollouts, summarise

RATES = {"prior": {256: 0.6, 512: 0.5}, "scratch": {256: 0.05, 512: 0.3}}


def simulate(rates=RATES, *, states=30, training_seeds=(0,), robot="ur5e", seed=0):
    rng = np.random.default_rng(seed)
    difficulty = {state: rng.random() for state in range(1000, 1000 + states)}
    return tuple(
        TrialRecord(
            task="pick",
            robot=robot,
            condition=condition,
            training_seed=training_seed,
            epoch=epoch,
            state_seed=state,
            success=(success := bool(0.5 * (difficulty[state] + rng.random()) < rate)),
            reason="" if success else str(rng.choice(["dropped", "never grasped"])),
            steps=int(rng.integers(20, 80)),
            seconds=float(rng.random()),
        )
        for condition, curve in rates.items()
        for epoch, rate in curve.items()
        for training_seed in training_seeds
        for state in difficulty
    )


def write(path, trials):
    path.write_text("".join(json.dumps(dataclasses.asdict(trial)) + "\n" for trial in trials))
    return path


def test_rollouts_come_back_as_written(tmp_path):
    trials = simulate()
    assert read_rollouts(write(tmp_path / "rollouts.jsonl", trials)) == trials


def test_a_field_from_a_later_version_is_no_fault(tmp_path):
    trial = simulate()[0]
    path = tmp_path / "rollouts.jsonl"
    path.write_text(json.dumps({**dataclasses.asdict(trial), "colour": "red"}) + "\n")
    assert read_rollouts(path) == (trial,)


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda line: line[: len(line) // 2], "line 3"),
        (lambda line: line.replace('"success": true', '"success": "yes"'), "line 3: success"),
        (lambda line: line.replace('"success": true, ', ""), "line 3: success"),
        (lambda line: line.replace('"epoch": ', '"epoch": -'), "line 3: epoch"),
        (lambda _: "", "line 3"),
        (lambda _: "[1, 2]", "line 3"),
    ],
)
def test_a_damaged_line_is_named(tmp_path, damage, complaint):
    trials = [dataclasses.replace(trial, success=True) for trial in simulate()[:5]]
    path = write(tmp_path / "rollouts.jsonl", trials)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:2], damage(lines[2]), *lines[3:]]))
    with pytest.raises(DataError, match=complaint) as caught:
        read_rollouts(path)
    assert str(path) in caught.value.message
    assert "geoprior evaluate" in caught.value.hint


def test_a_trial_that_stands_twice_is_named(tmp_path):
    trials = simulate()[:4]
    path = write(tmp_path / "rollouts.jsonl", [*trials, dataclasses.replace(trials[1], seconds=9.0)])
    with pytest.raises(DataError, match="line 5: the same trial as on line 2"):
        read_rollouts(path)


def test_missing_rollouts_are_named(tmp_path):
    with pytest.raises(DataError, match=r"rollouts\.jsonl"):
        read_rollouts(tmp_path / "rollouts.jsonl")


def test_counts_against_a_plain_recount():
    trials = simulate(training_seeds=(0, 7))
    results = summarise(trials, seed=0)
    for condition in results.groups[0].conditions:
        for checkpoint in condition.checkpoints:
            mine = [t for t in trials if (t.condition, t.epoch) == (condition.name, checkpoint.epoch)]
            assert checkpoint.trials == len(mine) == 60
            assert checkpoint.successes == sum(t.success for t in mine)
            assert checkpoint.rate == pytest.approx(checkpoint.successes / 60)
            assert checkpoint.interval.low <= checkpoint.rate <= checkpoint.interval.high
            assert sum(checkpoint.failure_reasons.values()) == 60 - checkpoint.successes
            assert sum(checkpoint.successes_by_training_seed.values()) == checkpoint.successes
            assert set(checkpoint.successes_by_training_seed) == {"0", "7"}


def test_curves_are_put_into_one_number_three_ways():
    condition = summarise(simulate(), seed=0).groups[0].conditions[0]
    rates = [checkpoint.rate for checkpoint in condition.checkpoints]
    assert condition.name == "prior"
    assert condition.last_checkpoint == condition.checkpoints[-1]
    assert condition.last_checkpoint.epoch == 512
    assert condition.area_under_curve == pytest.approx(sum(rates) / 2)
    assert condition.peak.rate == max(rates)
    assert condition.area_under_curve <= condition.peak.expected_if_flat <= 1.0


def test_comparisons_are_paired_at_every_shared_epoch():
    rates = {**RATES, "no-hand": {256: 0.4, 1024: 0.4}, "scratch": {256: 0.05, 512: 0.3, 1024: 0.5}}
    trials = simulate(rates)
    group = summarise(trials, seed=0).groups[0]
    assert [condition.name for condition in group.conditions] == ["no-hand", "prior", "scratch"]
    assert [comparison.condition for comparison in group.comparisons] == ["no-hand", "prior"]
    assert [checkpoint.epoch for checkpoint in group.comparisons[0].checkpoints] == [256, 1024]
    at = group.comparisons[1].checkpoints[1]
    success = {(t.condition, t.epoch, t.state_seed): t.success for t in trials}
    states = sorted({t.state_seed for t in trials})
    pairs = [(success["prior", 512, state], success["scratch", 512, state]) for state in states]
    assert at.pairs == 30
    assert at.condition_only == sum(one and not two for one, two in pairs)
    assert at.baseline_only == sum(two and not one for one, two in pairs)
    assert at.difference == pytest.approx((at.condition_only - at.baseline_only) / 30)
    assert at.interval.low <= at.difference <= at.interval.high


def test_the_difference_of_areas_is_the_area_of_differences():
    group = summarise(simulate(training_seeds=(0, 1, 2)), seed=0).groups[0]
    by_name = {condition.name: condition.area_under_curve for condition in group.conditions}
    found = group.comparisons[0].area_under_curve.difference
    assert found == pytest.approx(by_name["prior"] - by_name["scratch"], abs=1e-8)


def test_without_the_baseline_nothing_is_compared():
    assert summarise(simulate({"prior": RATES["prior"]}), seed=0).groups[0].comparisons == []


def test_without_a_shared_epoch_nothing_is_compared():
    trials = simulate({"prior": {256: 0.5}, "scratch": {512: 0.5}})
    assert summarise(trials, seed=0).groups[0].comparisons == []


@settings(max_examples=8)
@given(st.randoms(use_true_random=False))
def test_neither_the_order_nor_the_clock_changes_the_results(shuffler):
    trials = list(simulate(states=10))
    expected = summarise(trials, seed=3)
    later = [dataclasses.replace(trial, seconds=trial.seconds + 1.0) for trial in trials]
    shuffler.shuffle(later)
    assert summarise(later, seed=3).model_dump_json() == expected.model_dump_json()


def test_robots_are_told_apart():
    both = (*simulate(robot="ur5e"), *simulate(robot="kinova3", seed=1))
    groups = summarise(both, seed=0).groups
    assert [group.robot for group in groups] == ["kinova3", "ur5e"]
    assert groups[1] == summarise(simulate(robot="ur5e"), seed=0).groups[0]


def test_a_missing_trial_would_tear_a_pair():
    with pytest.raises(DataError, match=r"'prior' at epoch 512 lacks .* seed 0 on initial state 1029"):
        summarise([t for t in simulate() if t.key != ("prior", 0, 512, 1029)], seed=0)


def test_no_trials_are_no_results():
    with pytest.raises(DataError, match="no trials"):
        summarise([], seed=0)


def test_results_go_through_json_and_hold_no_timings():
    results = summarise(simulate(), seed=0)
    text = results.model_dump_json()
    assert parse_results(json.loads(text)) == results
    assert "seconds" not in text


@pytest.mark.parametrize(
    ("key", "value"), [("schema_version", 2), ("confidence", 1.5), ("groups", []), ("speed", 1)]
)
def test_foreign_results_are_refused_by_key(key, value):
    content = {**summarise(simulate(), seed=0).model_dump(mode="json"), key: value}
    with pytest.raises(DataError, match=key):
        parse_results(content)


def test_trials_in_different_looks_are_never_compared():
    plain = simulate()
    dim = tuple(dataclasses.replace(trial, look="dim", success=not trial.success) for trial in plain)
    together = summarise([*dim, *plain], seed=0)
    assert [group.look for group in together.groups] == ["dim", "plain"]
    alone = summarise(plain, seed=0)
    assert together.groups[1] == alone.groups[0]
