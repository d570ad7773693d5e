"""Drawing until something fits, with a bound and a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from geoprior.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable

ATTEMPTS = 2000

Value = TypeVar("Value")


def draw_until(draw: Callable[[], Value], fits: Callable[[Value], bool], what: str, hint: str) -> Value:
    """Call ``draw`` until ``fits`` accepts what it gives.

    Raises:
        ConfigError: Nothing fitted within `ATTEMPTS` draws: the config leaves no room.
    """
    for _ in range(ATTEMPTS):
        value = draw()
        if fits(value):
            return value
    raise ConfigError(f"scene: {what} found no place in {ATTEMPTS} draws", hint)
