"""What came out, in a sentence. The rule is fixed: the area under the curve and its paired interval."""

from __future__ import annotations

from dataclasses import dataclass

from geoprior.report.words import (
    capitalised,
    count,
    origin,
    percent,
    points,
    points_interval,
    subject,
)
from geoprior.study.schema import Comparison, ConditionResult, Difference, GroupResult
from geoprior.study.statistics import area_under_curve


@dataclass(frozen=True)
class Reading:
    """One comparison of two rates, for a reader.

    Attributes:
        title: Where it was measured, for example ``First checkpoint``.
        detail: More exactly where, for example ``256 epochs``.
        rates: Of the condition and the baseline: (name, rate as text).
        difference: In points, with its interval.
        clear: Whether the interval leaves out zero.
    """

    title: str
    detail: str
    rates: tuple[tuple[str, str], tuple[str, str]]
    difference: str
    clear: bool


def headline(group: GroupResult) -> str:
    """One sentence: the success rates over the curve, and who is ahead, if anybody is."""
    comparison = main_comparison(group)
    if comparison is None:
        best = group.conditions[0]
        return capitalised(f"{origin(best.name)} {percent(best.area_under_curve)} success")
    area_condition, area_baseline = _shared_areas(_pair(group, comparison), comparison)
    return capitalised(
        f"{origin(comparison.condition)} {percent(area_condition)}, {origin(comparison.baseline)} "
        f"{percent(area_baseline)}: {_verdict(comparison)}"
    )


def explanation(group: GroupResult, confidence: float) -> str:
    """What the headline's rates are rates of."""
    comparison = main_comparison(group)
    measured = group.conditions[0].checkpoints if comparison is None else comparison.checkpoints
    first, last = measured[0].epoch, measured[-1].epoch
    where = (
        f"after {count(last)} fine-tuning epochs"
        if first == last
        else f"averaged over the learning curve from {count(first)} to {count(last)} fine-tuning epochs"
    )
    seen = "" if group.look == "plain" else f", seen in the look {group.look}"
    text = f"Success rate on the task {group.task} with the robot {group.robot}{seen}, {where}."
    if comparison is None:
        return f"{text} There was nothing to compare it with on the same initial states."
    area = comparison.area_under_curve
    return (
        f"{text} On the same initial states the difference is {points(area.difference)} points "
        f"({percent(confidence)} interval {points_interval(area.interval)})."
    )


def readings(group: GroupResult) -> list[Reading]:
    """The first checkpoint, the whole curve and the last one: all three fixed in advance."""
    comparison = main_comparison(group)
    if comparison is None:
        return []
    first, last = comparison.checkpoints[0], comparison.checkpoints[-1]
    pair = _pair(group, comparison)

    only = [
        _reading("The checkpoint", f"{count(last.epoch)} epochs", comparison, _rates(pair, last.epoch), last)
    ]
    if first.epoch == last.epoch:
        return only
    areas = _shared_areas(pair, comparison)
    span = f"mean from {count(first.epoch)} to {count(last.epoch)} epochs"
    return [
        _reading(
            "First checkpoint", f"{count(first.epoch)} epochs", comparison, _rates(pair, first.epoch), first
        ),
        _reading("Whole curve", span, comparison, areas, comparison.area_under_curve),
        _reading(
            "Last checkpoint", f"{count(last.epoch)} epochs", comparison, _rates(pair, last.epoch), last
        ),
    ]


def main_comparison(group: GroupResult) -> Comparison | None:
    """The one that the headline is about: the prior's, or else the first."""
    named = [comparison for comparison in group.comparisons if comparison.condition == "prior"]
    return next(iter([*named, *group.comparisons]), None)


def caution(group: GroupResult) -> str:
    """What the number of training seeds allows one to conclude."""
    seeds = len(group.training_seeds)
    if seeds == 1:
        return (
            "A demonstration on one training seed, not the evidence. The intervals cover which initial "
            "states were drawn, not the luck of a training: another seed may come out otherwise, and so "
            "may a neighbouring checkpoint. Train several seeds before you conclude anything."
        )
    if seeds < 5:
        return (
            f"{seeds} training seeds. The paired intervals cover both the trainings and the initial states, "
            "but so few seeds say little about how much trainings differ."
        )
    return ""


def _pair(group: GroupResult, comparison: Comparison) -> tuple[ConditionResult, ConditionResult]:
    by_name = {condition.name: condition for condition in group.conditions}
    return by_name[comparison.condition], by_name[comparison.baseline]


def _rates(pair: tuple[ConditionResult, ConditionResult], epoch: int) -> tuple[float, float]:
    first, second = (
        next(point.rate for point in condition.checkpoints if point.epoch == epoch) for condition in pair
    )
    return first, second


def _shared_areas(
    pair: tuple[ConditionResult, ConditionResult], comparison: Comparison
) -> tuple[float, float]:
    """Areas over the epochs that both have: what the paired difference is the difference of."""
    epochs = [point.epoch for point in comparison.checkpoints]
    rates = [_rates(pair, epoch) for epoch in epochs]
    first, second = (area_under_curve(epochs, [rate[side] for rate in rates]) for side in (0, 1))
    return first, second


def _verdict(comparison: Comparison) -> str:
    interval = comparison.area_under_curve.interval
    if interval.low > 0.0:
        return f"{subject(comparison.condition)} is ahead"
    if interval.high < 0.0:
        return f"{subject(comparison.baseline)} is ahead"
    return "no clear difference"


def _reading(
    title: str, detail: str, comparison: Comparison, rates: tuple[float, float], paired: Difference
) -> Reading:
    return Reading(
        title=title,
        detail=detail,
        rates=((comparison.condition, percent(rates[0])), (comparison.baseline, percent(rates[1]))),
        difference=f"{points(paired.difference)} points ({points_interval(paired.interval)})",
        clear=paired.interval.low > 0.0 or paired.interval.high < 0.0,
    )
