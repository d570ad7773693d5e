"""The page: one HTML file that needs neither a server nor the net, with its media beside it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from geoprior.probe.sight import Sight
from geoprior.report import controls, words
from geoprior.report.headline import caution, explanation, headline, readings
from geoprior.report.palette import colours_of
from geoprior.study.schema import (
    CheckpointDifference,
    CheckpointResult,
    ConditionResult,
    GroupResult,
    Results,
)


@dataclass(frozen=True)
class Picture:
    """A figure in two widths.

    Attributes:
        wide: Path from the page.
        narrow: Path from the page, for narrow screens.
        alt: What it shows, for those who cannot see it.
        caption: The sentence below it.
    """

    wide: str
    narrow: str
    alt: str
    caption: str


@dataclass(frozen=True)
class PageMedia:
    """An image or a film where the page finds it.

    Attributes:
        source: Path from the page.
        caption: The sentence below it, also its alternative text.
        kind: ``image`` or ``film``.
        condition: Which condition it shows, or empty.
    """

    source: str
    caption: str
    kind: str
    condition: str


@dataclass(frozen=True)
class SightSection:
    """Whether the prior looks.

    Attributes:
        sentence: The answer.
        caution: What is wrong and what to do, or an empty string.
        picture: Errors over pretraining.
        rows: By motion, ``all`` first, at the end of pretraining.
    """

    sentence: str
    caution: str
    picture: Picture
    rows: Sequence[tuple[str, Sight]]


@dataclass(frozen=True)
class Row:
    """One checkpoint of the table: a cell for each condition and for each comparison, or None."""

    epoch: int
    cells: Sequence[CheckpointResult | None]
    differences: Sequence[CheckpointDifference | None]


@dataclass(frozen=True)
class ReasonRow:
    """How often one reason ended a rollout, by condition, over all checkpoints."""

    reason: str
    counts: Sequence[int]


@dataclass(frozen=True)
class GroupSection:
    """What the page says of one robot and task."""

    result: GroupResult
    title: str
    explanation: str
    caution: str
    readings: Sequence[Any]
    colours: Mapping[str, str]
    picture: Picture
    rows: Sequence[Row]
    reasons: Sequence[ReasonRow]
    failures: Sequence[int]
    gain_sentences: Sequence[str]


@dataclass(frozen=True)
class Stage:
    """A stage of the run and its share of the time."""

    name: str
    seconds: float
    share: float
    facts: str


def group_section(group: GroupResult, picture: Picture, confidence: float) -> GroupSection:
    """Arrange one group's numbers for the page."""
    reasons, failures = _reasons(group)
    return GroupSection(
        result=group,
        title=headline(group),
        explanation=explanation(group, confidence),
        caution=caution(group),
        readings=readings(group),
        colours=colours_of([condition.name for condition in group.conditions]),
        picture=picture,
        rows=_rows(group),
        reasons=reasons,
        failures=failures,
        gain_sentences=controls.sentences(group),
    )


def render(
    results: Results,
    groups: Sequence[GroupSection],
    *,
    media: Mapping[str, Sequence[PageMedia]],
    losses: Picture | None,
    sight: SightSection | None = None,
    config_text: str,
    run: Mapping[str, Any],
) -> str:
    """The whole page as HTML.

    Args:
        results: What ``results.json`` holds.
        groups: One for each robot and task, at least one.
        media: By section: ``synthetic``, ``demonstrations``, ``rollouts``.
        losses: Figure of the training losses, if there are any.
        sight: Whether the prior looks, if that was measured.
        config_text: The resolved config.
        run: What ``run.json`` holds; missing parts are left out.
    """
    environment = Environment(
        loader=PackageLoader("geoprior.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        name: getattr(words, name)
        for name in (
            "count",
            "duration",
            "p_value",
            "percent",
            "percent_interval",
            "points",
            "points_interval",
        )
    }
    environment.filters |= {
        name: getattr(controls, name) for name in ("share_percent", "share_percent_interval")
    }
    return environment.get_template("report.html").render(
        results=results,
        groups=groups,
        media=media,
        films=_by_condition(media["rollouts"]),
        losses=losses,
        sight=sight,
        config_text=config_text,
        stages=stages(run),
        versions=_texts(run.get("versions")),
        machine=_texts(run.get("machine")),
        plugins=run.get("plugins") or [],
        seed=run.get("seed"),
    )


def stages(run: Mapping[str, Any]) -> list[Stage]:
    """The stages that ``run.json`` knows, with their times; the longest has share 1."""
    found = {
        name: record
        for name, record in (run.get("stages") or {}).items()
        if isinstance(record, Mapping) and isinstance(record.get("seconds"), int | float)
    }
    longest = max([record["seconds"] for record in found.values()], default=0.0) or 1.0
    return [
        Stage(name, float(record["seconds"]), record["seconds"] / longest, _facts(record.get("result")))
        for name, record in found.items()
    ]


def _by_condition(media: Sequence[PageMedia]) -> dict[str, list[PageMedia]]:
    found: dict[str, list[PageMedia]] = {}
    for one in media:
        found.setdefault(one.condition, []).append(one)
    return found


def _rows(group: GroupResult) -> list[Row]:
    epochs = sorted({point.epoch for condition in group.conditions for point in condition.checkpoints})
    return [
        Row(
            epoch=epoch,
            cells=[_at(condition.checkpoints, epoch) for condition in group.conditions],
            differences=[_at(comparison.checkpoints, epoch) for comparison in group.comparisons],
        )
        for epoch in epochs
    ]


def _at(points: Sequence[Any], epoch: int) -> Any:
    return next((point for point in points if point.epoch == epoch), None)


def _reasons(group: GroupResult) -> tuple[list[ReasonRow], list[int]]:
    counts = [_reason_counts(condition) for condition in group.conditions]
    total = sum(counts, Counter[str]())
    ordered = sorted(total, key=lambda reason: (-total[reason], reason))
    rows = [ReasonRow(reason, [count[reason] for count in counts]) for reason in ordered]
    return rows, [count.total() for count in counts]


def _reason_counts(condition: ConditionResult) -> Counter[str]:
    total: Counter[str] = Counter()
    for point in condition.checkpoints:
        total.update(point.failure_reasons)
    return total


def _facts(result: object) -> str:
    if not isinstance(result, Mapping):
        return ""
    plain = {key: value for key, value in result.items() if isinstance(value, str | int | float)}
    return ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in plain.items())


def _texts(values: object) -> dict[str, str]:
    if not isinstance(values, Mapping):
        return {}
    return {str(key): str(value) for key, value in values.items() if str(value)}
