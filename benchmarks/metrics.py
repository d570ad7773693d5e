"""What every benchmark prints: one object, the same fields whatever was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from geoprior.provenance import machine, versions


@dataclass(frozen=True)
class Metric:
    """One number.

    Attributes:
        metric: What it is of.
        value: The number.
        unit: Its unit.
        goal: What it should reach, or None where it is only told.
        met: Whether it does; None without a goal.
    """

    metric: str
    value: float
    unit: str
    goal: float | None = None
    met: bool | None = None


def at_most(metric: str, value: float, unit: str, goal: float) -> Metric:
    """A number that should not be above its goal."""
    return Metric(metric, value, unit, goal, value <= goal)


def at_least(metric: str, value: float, unit: str, goal: float) -> Metric:
    """A number that should not be below its goal."""
    return Metric(metric, value, unit, goal, value >= goal)


def report(name: str, command: str, metrics: Sequence[Metric]) -> dict[str, Any]:
    """The object that `python -m benchmarks NAME --json` prints."""
    return {
        "name": name,
        "command": command,
        "machine": machine(),
        "versions": versions(),
        "results": [asdict(metric) for metric in metrics],
    }


def as_lines(content: dict[str, Any]) -> list[str]:
    """The same for a terminal: a line for each number."""
    where = content["machine"]
    lines = [f"{content['name']} on {where['cores']} cores of {where['processor']}"]
    for row in content["results"]:
        goal = "" if row["goal"] is None else f"  goal {row['goal']:g}: {'met' if row['met'] else 'MISSED'}"
        lines.append(f"  {row['metric']:<58} {row['value']:>12,.4g} {row['unit']}{goal}")
    return lines
