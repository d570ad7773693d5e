"""How the objects of a task are strewn on the table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray


class Range(Protocol):
    """The options of a task with two objects; metres."""

    @property
    def range_x(self) -> float:
        """Half of the rectangle's length along x."""
        ...

    @property
    def range_y(self) -> float:
        """Half of the rectangle's length along y."""
        ...

    @property
    def gap(self) -> float:
        """From one object's middle to the other's, at least."""
        ...


def draw_two_places(rng: np.random.Generator, middle: FloatArray, config: Range) -> FloatArray:
    """(2, 2) places anywhere in a rectangle about ``middle`` (2,), drawn again until they are apart."""
    reach = np.array([config.range_x, config.range_y])
    first, second = middle, middle
    while np.linalg.norm(first - second) < config.gap:
        first, second = middle + rng.uniform(-reach, reach, (2, 2))
    return np.stack([first, second])
