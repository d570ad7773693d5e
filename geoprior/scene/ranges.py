"""Ranges ``[low, high]`` that a config gives and an episode draws from. Light: pydantic only."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, Discriminator, Field, Tag

if TYPE_CHECKING:
    import numpy as np


def _ordered(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] > value[1]:
        raise ValueError(f"a range is [low, high], but {value[0]} > {value[1]}")
    return value


def _ordered_counts(value: tuple[int, int]) -> tuple[int, int]:
    _ordered(value)
    return value


Length = Annotated[float, Field(gt=0.0, le=10.0)]
Height = Annotated[float, Field(ge=-1.0, le=1.0)]
Distance = Annotated[float, Field(ge=0.0, le=10.0)]
Degrees = Annotated[float, Field(ge=-180.0, le=180.0)]
Elevation = Annotated[float, Field(ge=0.0, le=85.0)]
Fraction = Annotated[float, Field(gt=0.0, lt=1.0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Offset = Annotated[float, Field(ge=-1.0, le=1.0)]
Seconds = Annotated[float, Field(gt=0.0, le=3600.0)]
Slack = Annotated[float, Field(ge=1.0, le=10.0)]
Count = Annotated[int, Field(ge=0, le=100)]
SideCount = Annotated[int, Field(ge=3, le=64)]

LengthRange = Annotated[tuple[Length, Length], AfterValidator(_ordered)]
HeightRange = Annotated[tuple[Height, Height], AfterValidator(_ordered)]
DistanceRange = Annotated[tuple[Distance, Distance], AfterValidator(_ordered)]
DegreeRange = Annotated[tuple[Degrees, Degrees], AfterValidator(_ordered)]
ElevationRange = Annotated[tuple[Elevation, Elevation], AfterValidator(_ordered)]
FractionRange = Annotated[tuple[Fraction, Fraction], AfterValidator(_ordered)]
ShareRange = Annotated[tuple[Share, Share], AfterValidator(_ordered)]
OffsetRange = Annotated[tuple[Offset, Offset], AfterValidator(_ordered)]
SecondsRange = Annotated[tuple[Seconds, Seconds], AfterValidator(_ordered)]
SlackRange = Annotated[tuple[Slack, Slack], AfterValidator(_ordered)]
CountRange = Annotated[tuple[Count, Count], AfterValidator(_ordered_counts)]
SideCountRange = Annotated[tuple[SideCount, SideCount], AfterValidator(_ordered_counts)]

# What is written with brackets is a range: a fault is then told once, and not of both forms.
_FORM = Discriminator(lambda value: "range" if isinstance(value, list | tuple) else "number")
DistanceOrRange = Annotated[
    Annotated[Distance, Tag("number")] | Annotated[DistanceRange, Tag("range")], _FORM
]
SecondsOrRange = Annotated[Annotated[Seconds, Tag("number")] | Annotated[SecondsRange, Tag("range")], _FORM]


def uniform(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    """Draw from the closed range ``bounds``, every value as likely."""
    return float(rng.uniform(bounds[0], bounds[1]))


def integer(rng: np.random.Generator, bounds: tuple[int, int]) -> int:
    """Draw a whole number from ``bounds``, both ends among them."""
    return int(rng.integers(bounds[0], bounds[1], endpoint=True))
