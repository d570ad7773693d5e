"""The learning rate over a training: a pure function of the step, so that a resumed training needs no state.

torch's schedulers give the same values but keep a count and rates of their own, which would have to be saved
and restored with the optimiser's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geoprior.training.config import TrainConfig


def rate_at(config: TrainConfig, step: int, steps: int) -> float:
    """The share of the full learning rate that an optimiser step gets.

    Args:
        config: Its `warmup_steps`, `schedule` and `final_rate`.
        step: Number of the step, from 0.
        steps: Of the whole training.

    Returns:
        The linear warm-up, which ends at 1 with step ``warmup_steps - 1``, times the schedule's share of the
        steps after it.
    """
    warm = min(1.0, (step + 1) / config.warmup_steps) if config.warmup_steps else 1.0
    begun, length = step - config.warmup_steps, steps - config.warmup_steps
    if begun <= 0:
        return warm
    return _SCHEDULES[config.schedule](begun / length, config.final_rate)


def _constant(_: float, __: float) -> float:
    return 1.0


def _cosine(done: float, final: float) -> float:
    """From 1 to ``final`` along half a cosine (Loshchilov and Hutter 2017, equation 5)."""
    return final + (1.0 - final) * 0.5 * (1.0 + math.cos(math.pi * done))


_SCHEDULES: dict[str, Callable[[float, float], float]] = {"constant": _constant, "cosine": _cosine}
