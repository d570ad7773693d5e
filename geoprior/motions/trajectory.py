"""What a motion plans: hand, gripper and object over time, and the marker if there is one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Trajectory:
    """N time steps of one hand and one object.

    Attributes:
        transforms_hand_to_world: (N, 4, 4); hand axes [right, up, forward].
        gripper: (N,) float64, 0 open or 1 closed.
        transforms_object_to_world: (N, 4, 4).
        marker_points: (M, 3) world points of the goal drawn on the floor, or None.
        phases: Name of the phase of each step, for example ``approach`` or ``transport``.
    """

    transforms_hand_to_world: NDArray[np.float64]
    gripper: NDArray[np.float64]
    transforms_object_to_world: NDArray[np.float64]
    marker_points: NDArray[np.float64] | None
    phases: tuple[str, ...]
