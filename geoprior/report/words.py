"""Numbers as a reader wants them: percent, points, counts, times."""

from __future__ import annotations

from geoprior.study.schema import Bounds

SPACE = "\u202f"
"""A narrow space that does not break, between a number and its unit."""
MINUS = "\u2212"

ORIGINS = {"prior": "from the prior", "scratch": "from scratch"}
SUBJECTS = {"prior": "the prior", "scratch": "scratch"}


def percent(rate: float) -> str:
    """``0.633`` as ``63 %``."""
    return f"{_half_up(100.0 * rate)}{SPACE}%"


def percent_interval(bounds: Bounds) -> str:
    """An interval of rates, ``46 to 78 %``."""
    return f"{_half_up(100.0 * bounds.low)} to {percent(bounds.high)}"


def points(difference: float) -> str:
    """A difference of rates in signed percentage points, ``+63`` or ``−4``."""
    rounded = _half_up(100.0 * abs(difference))
    if rounded == 0:
        return "0"
    return f"{'+' if difference > 0 else MINUS}{rounded}"


def points_interval(bounds: Bounds) -> str:
    """An interval of differences in points, ``+43 to +80``."""
    return f"{points(bounds.low)} to {points(bounds.high)}"


def count(number: int) -> str:
    """``1024`` as ``1,024``."""
    return f"{number:,}"


def p_value(p: float) -> str:
    """Two digits that count; never an exact zero."""
    if p < 0.001:
        return f"<{SPACE}0.001"
    return f"{p:.3f}" if p < 0.1 else f"{p:.2f}"


def duration(seconds: float) -> str:
    """``75.4`` as ``1 min 15 s``."""
    if seconds < 10.0:
        return f"{seconds:.1f}{SPACE}s"
    whole = round(seconds)
    hours, minutes = divmod(whole // 60, 60)
    if hours:
        return f"{hours}{SPACE}h {minutes}{SPACE}min"
    return f"{minutes}{SPACE}min {whole % 60}{SPACE}s" if minutes else f"{whole}{SPACE}s"


def origin(condition: str) -> str:
    """What a policy started from, inside a sentence: ``from the prior``."""
    return ORIGINS.get(condition, f"with {condition}")


def subject(condition: str) -> str:
    """A condition as the subject of a sentence: ``the prior``."""
    return SUBJECTS.get(condition, condition)


def capitalised(sentence: str) -> str:
    """The sentence with a capital first letter and the rest as it is."""
    return sentence[:1].upper() + sentence[1:]


def _half_up(value: float) -> int:
    """Nearest integer; 12.5 gives 13, and a last-bit error of 12.5 still does."""
    return int(value + 0.5 + 1e-9)
