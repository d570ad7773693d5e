"""Targets on their way into a batch: scaled, so that their errors are of one size; NaN stays NaN."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from geoprior.episode import HAND_AXES, IMAGE_AXES

if TYPE_CHECKING:
    from numpy.typing import NDArray

UNIT = 0.15
"""Metres that become 1 of what lies in a hand's frame."""
FARTHEST = 1.5
"""Half-frames beyond which it does not matter how far outside an image something lies."""


def scale_targets(names: Sequence[str], values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Scale what lies in a hand's frame, clip what lies in an image; other targets stay.

    Args:
        names: Of T targets; see `geoprior.synthesis.targets`.
        values: (..., T), NaN where there is none.
    """
    units = np.array([UNIT if axis_of(name) in HAND_AXES else 1.0 for name in names])
    bounds = np.array([FARTHEST if axis_of(name) in IMAGE_AXES else np.inf for name in names])
    return np.asarray(np.clip(values / units, -bounds, bounds).astype(np.float32))


def axis_of(name: str) -> str:
    """The last part of a target's name."""
    return name.rpartition(".")[2]
