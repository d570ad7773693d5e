"""The floor plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.scene.ranges import uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.config import FloorConfig


@dataclass(frozen=True)
class Floor:
    """A square about the origin, drawn as a grid of points.

    Attributes:
        side: Metres.
        height: z of the plane, metres.
        spacing: Metres between neighbouring points.
        points: (P, 3) world.
    """

    side: float
    height: float
    spacing: float
    points: NDArray[np.float64]


def draw_floor(config: FloorConfig, rng: np.random.Generator) -> Floor:
    """Draw side, height and grid resolution."""
    side, height = uniform(rng, config.side), uniform(rng, config.height)
    spacing = min(uniform(rng, config.spacing), side)
    steps = int(side / spacing)
    line = spacing * (np.arange(steps + 1) - 0.5 * steps)
    points = np.empty((len(line), len(line), 3))
    points[..., 0], points[..., 1], points[..., 2] = line[:, None], line, height
    return Floor(side, height, spacing, points.reshape(-1, 3))
