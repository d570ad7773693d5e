"""Two fingers at a hand: boxes that reach from the hand's cube to just past the hand's origin.

They open and close along the hand's right axis, and meet at the hand's origin as a gripper's do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.scene.mesh import Mesh, bounds, box
from geoprior.scene.ranges import uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.config import FingersConfig

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Fingers:
    """A hand's two fingers.

    Attributes:
        opening: Between them where the gripper is open, metres.
        thickness: Of each, along the hand's right, metres.
        width: Of each, along the hand's up, metres.
        length: How far behind the hand's origin they begin, metres.
        past: How far past the hand's origin they reach, metres.
        points: Along an edge of a finger.
    """

    opening: float
    thickness: float
    width: float
    length: float
    past: float
    points: int

    def pair(self) -> tuple[Mesh, Mesh]:
        """Both fingers as they meet, in the hand frame: the one towards plus right comes first."""
        low, high = np.array([0.0, -0.5 * self.width, -self.length]), 0.5 * self.width
        right = box(low, np.array([self.thickness, high, self.past]))
        left = box(low - np.array([self.thickness, 0.0, 0.0]), np.array([0.0, high, self.past]))
        return right, left

    def gaps(self, openness: FloatArray, grip: float) -> FloatArray:
        """(N,) metres between the fingers.

        Args:
            openness: (N,) from 0, closed, to 1, open.
            grip: Between the closed fingers, metres; no more than the opening is kept.
        """
        closed = min(grip, self.opening)
        return np.asarray(closed + openness * (self.opening - closed))


def draw_fingers(config: FingersConfig, setback: float, rng: np.random.Generator) -> Fingers:
    """Draw the fingers of a hand whose cube begins ``setback`` metres behind its origin."""
    return Fingers(
        opening=uniform(rng, config.opening),
        thickness=uniform(rng, config.thickness),
        width=uniform(rng, config.width),
        length=setback,
        past=uniform(rng, config.past),
        points=config.points,
    )


def box_points(mesh: Mesh, count: int) -> FloatArray:
    """Lattice points (P, 3) on the surface of a box, ``count`` along each of its edges."""
    low, high = bounds(mesh)
    line = np.linspace(0.0, 1.0, count)
    lattice = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    shell = lattice[np.abs(lattice - 0.5).max(axis=1) == 0.5]
    return np.asarray(low + shell * (high - low))
