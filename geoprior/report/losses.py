"""Training logs: ``log.jsonl``, one flat JSON object a line with step, epoch and named losses."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoprior.errors import DataError

METRICS = ("l1", "loss")
MAX_POINTS = 150


@dataclass(frozen=True)
class LossCurve:
    """One training's loss.

    Attributes:
        name: Of the training, for example ``pretrain`` or ``finetune/prior-s0``.
        metric: Which loss it is: ``l1`` where the log has it, else ``loss``.
        x_name: ``epoch`` where the log has it, else ``step``.
        x: (P,) rising.
        values: (P,) means over equal stretches of the log.
        damaged: Lines that could not be read and were left out.
    """

    name: str
    metric: str
    x_name: str
    x: NDArray[np.float64]
    values: NDArray[np.float64]
    damaged: int


def read_log(name: str, path: Path) -> LossCurve | None:
    """Read one training's log.

    A line that a killed training cut off is left out and counted; of steps that a resumed training
    repeated, the last stands.

    Returns:
        The curve, or None when the log has no loss in it.

    Raises:
        DataError: The file cannot be read.
    """
    ordered, damaged = read_entries(path)
    for metric in METRICS:
        found = [(entry, value) for entry in ordered if (value := _number(entry, metric)) is not None]
        if found:
            break
    else:
        return None
    x_name = "epoch" if all(_number(entry, "epoch") is not None for entry, _ in found) else "step"
    x = np.array([float(entry[x_name]) for entry, _ in found])
    values = np.array([value for _, value in found])
    return LossCurve(name, metric, x_name, _thin(x), _thin(values), damaged)


def read_entries(path: Path) -> tuple[list[Mapping[str, Any]], int]:
    """The whole lines of a log by rising step, and how many were damaged; see `read_log`.

    Raises:
        DataError: The file cannot be read.
    """
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})") from error
    entries = [_entry(line) for line in lines]
    by_step = {
        step: entry for entry in entries if entry is not None and (step := _number(entry, "step")) is not None
    }
    return [by_step[step] for step in sorted(by_step)], entries.count(None)


def _entry(line: bytes) -> Mapping[str, Any] | None:
    try:
        value = json.loads(line)
    except ValueError:
        return None
    if not isinstance(value, dict):
        return None
    nested = value.get("metrics")
    return {**value, **nested} if isinstance(nested, dict) else value


def _number(entry: Mapping[str, Any], key: str) -> float | None:
    value = entry.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _thin(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means over at most ``MAX_POINTS`` stretches; none is longer than another by more than one value."""
    stretch = -(-len(values) // MAX_POINTS)
    parts = np.array_split(values, -(-len(values) // stretch))
    return np.array([part.mean() for part in parts])
