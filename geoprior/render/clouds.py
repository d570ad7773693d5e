"""What a renderer is given: groups of points that move as one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Cloud:
    """Points of one rigid body.

    Attributes:
        points: (P, 3) metres, in the body's own frame.
        transforms_cloud_to_world: (4, 4) of a body at rest, or (N, 4, 4), one a time step.
    """

    points: NDArray[np.float64]
    transforms_cloud_to_world: NDArray[np.float64]
