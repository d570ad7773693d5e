"""Closed triangle meshes: the one form in which every primitive hands over its solid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Mesh:
    """A closed surface.

    Attributes:
        vertices: (V, 3) float64, metres, object frame.
        faces: (F, 3) int64, counter-clockwise seen from outside.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
