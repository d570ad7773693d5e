"""From trials to ``results.json``: curves, their summaries and paired comparisons."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from geoprior.errors import DataError
from geoprior.geometry.seeding import generator
from geoprior.sim.records import TrialRecord
from geoprior.study.paired import Outcomes, area_table, bounds, difference, rounded
from geoprior.study.schema import (
    CheckpointDifference,
    CheckpointResult,
    Comparison,
    ConditionResult,
    Control,
    GroupResult,
    PeakResult,
    Results,
    parse_results,
)
from geoprior.study.shares import gain_shares
from geoprior.study.statistics import (
    BOOTSTRAP_SAMPLES,
    CONFIDENCE,
    area_under_curve,
    expected_peak,
    find_peak,
    mcnemar_exact,
    rate_interval,
)
from geoprior.study.trials import read_rollouts

__all__ = ["BASELINE", "Results", "TrialRecord", "parse_results", "read_rollouts", "summarise"]

BASELINE = "scratch"


def summarise(
    trials: Iterable[TrialRecord],
    *,
    seed: int,
    baseline: str = BASELINE,
    controls: Mapping[str, Control] | None = None,
) -> Results:
    """Everything that ``results.json`` says.

    Args:
        trials: In any order; every condition must have met the same initial states with the same training
            seeds at each of its epochs.
        seed: Root seed; names the bootstrap's resamples.
        baseline: The condition that the others are compared with; without it there are no comparisons.
        controls: What conditions tell of the prior's gain; see `geoprior.study.shares.controls_of`.

    Returns:
        A pure function of the set of trials and the seed; times do not enter.

    Raises:
        DataError: There are no trials, or one is missing, so that pairs would be torn.
    """
    groups: dict[tuple[str, str, str], list[TrialRecord]] = {}
    for trial in sorted(trials, key=lambda trial: (trial.scene, trial.key)):
        groups.setdefault(trial.scene, []).append(trial)
    if not groups:
        raise DataError(
            "there are no trials to summarise", "run `geoprior evaluate` on this run folder first"
        )
    return Results(
        confidence=CONFIDENCE,
        bootstrap_samples=BOOTSTRAP_SAMPLES,
        groups=[_group(group, seed, baseline, controls or {}) for group in groups.values()],
    )


def _group(
    trials: Sequence[TrialRecord], seed: int, baseline: str, controls: Mapping[str, Control]
) -> GroupResult:
    robot, task, look = scene = trials[0].scene
    training_seeds = sorted({trial.training_seed for trial in trials})
    state_seeds = sorted({trial.state_seed for trial in trials})
    names = sorted({trial.condition for trial in trials}, key=lambda name: (name == baseline, name))
    by_name = {name: [trial for trial in trials if trial.condition == name] for name in names}
    outcomes = {name: _outcomes(by_name[name], training_seeds, state_seeds) for name in names}
    others = [name for name in names if name != baseline] if baseline in names else []
    return GroupResult(
        robot=robot,
        task=task,
        look=look,
        training_seeds=training_seeds,
        initial_states=len(state_seeds),
        conditions=[_condition(name, by_name[name], outcomes[name], training_seeds) for name in names],
        comparisons=[
            comparison
            for name in others
            if (comparison := _compare(name, baseline, outcomes, seed, scene)) is not None
        ],
        gain_shares=gain_shares(outcomes, baseline, controls, seed=seed, scene=scene),
    )


def _outcomes(
    trials: Sequence[TrialRecord], training_seeds: Sequence[int], state_seeds: Sequence[int]
) -> Outcomes:
    success = {(trial.epoch, trial.training_seed, trial.state_seed): trial.success for trial in trials}
    if len(success) != len(trials):
        raise DataError(f"{trials[0].condition}: a trial is there twice")
    epochs = sorted({trial.epoch for trial in trials})
    for epoch, training_seed, state_seed in product(epochs, training_seeds, state_seeds):
        if (epoch, training_seed, state_seed) not in success:
            raise DataError(
                f"condition {trials[0].condition!r} at epoch {epoch} lacks the trial of training seed "
                f"{training_seed} on initial state {state_seed}; only equal initial states can be compared",
                "run `geoprior evaluate` on this run folder again",
            )
    return {
        epoch: np.array([[success[epoch, row, column] for column in state_seeds] for row in training_seeds])
        for epoch in epochs
    }


def _condition(
    name: str, trials: Sequence[TrialRecord], outcomes: Outcomes, training_seeds: Sequence[int]
) -> ConditionResult:
    epochs = sorted(outcomes)
    checkpoints = [
        _checkpoint(epoch, [trial for trial in trials if trial.epoch == epoch], outcomes, training_seeds)
        for epoch in epochs
    ]
    rates = [checkpoint.successes / checkpoint.trials for checkpoint in checkpoints]
    area = area_under_curve(epochs, rates)
    peak = find_peak(epochs, rates)
    expected = expected_peak(area, checkpoints=len(epochs), trials=checkpoints[0].trials)
    return ConditionResult(
        name=name,
        checkpoints=checkpoints,
        last_checkpoint=checkpoints[-1],
        area_under_curve=rounded(area),
        peak=PeakResult(epoch=peak.epoch, rate=rounded(peak.rate), expected_if_flat=rounded(expected)),
    )


def _checkpoint(
    epoch: int, trials: Sequence[TrialRecord], outcomes: Outcomes, training_seeds: Sequence[int]
) -> CheckpointResult:
    successes = sum(trial.success for trial in trials)
    reasons = Counter(trial.reason or "not said" for trial in trials if not trial.success)
    return CheckpointResult(
        epoch=epoch,
        trials=len(trials),
        successes=successes,
        rate=rounded(successes / len(trials)),
        interval=bounds(rate_interval(outcomes[epoch])),
        successes_by_training_seed={
            str(seed): sum(trial.success for trial in trials if trial.training_seed == seed)
            for seed in training_seeds
        },
        failure_reasons=dict(sorted(reasons.items())),
    )


def _compare(
    name: str, baseline: str, outcomes: dict[str, Outcomes], seed: int, group: tuple[str, str, str]
) -> Comparison | None:
    first, second = outcomes[name], outcomes[baseline]
    epochs = sorted(first.keys() & second.keys())
    if not epochs:
        return None
    keys = ("compare", *group, name, baseline)
    return Comparison(
        condition=name,
        baseline=baseline,
        checkpoints=[_at_checkpoint(epoch, first[epoch], second[epoch], seed, keys) for epoch in epochs],
        area_under_curve=difference(
            area_table(first, epochs) - area_table(second, epochs), generator(seed, *keys, "area")
        ),
    )


def _at_checkpoint(
    epoch: int,
    first: NDArray[np.bool_],
    second: NDArray[np.bool_],
    seed: int,
    keys: tuple[str, ...],
) -> CheckpointDifference:
    paired = difference(first.astype(np.float64) - second, generator(seed, *keys, epoch))
    test = mcnemar_exact(first, second)
    return CheckpointDifference(
        epoch=epoch,
        pairs=first.size,
        difference=paired.difference,
        interval=paired.interval,
        condition_only=test.first_only,
        baseline_only=test.second_only,
        mcnemar_p=rounded(test.p_value),
    )
