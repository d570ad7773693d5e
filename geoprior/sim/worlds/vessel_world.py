"""A world whose objects are vessels that stand and can fall over."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.sim.worlds.tabletop import TABLE_TOP, Tabletop
from geoprior.sim.worlds.vessels import CAN_RADIUS

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray

LYING = np.cos(np.radians(60.0))
"""Cosine between a vessel's axis and the vertical."""


class VesselWorld(Tabletop):
    """See `Tabletop`."""

    def put(self, vessel: Any, position: FloatArray, tilt: float = 0.0) -> None:
        """Set a vessel up, at rest.

        Args:
            vessel: One of `geoprior.sim.worlds.vessels`.
            position: (3,) of the middle of its foot in the workspace frame, metres.
            tilt: Radians by which it leans about +x.
        """
        turn = np.array([np.cos(tilt / 2.0), np.sin(tilt / 2.0), 0.0, 0.0])
        self.sim.data.set_joint_qpos(vessel.joints[0], np.concatenate([TABLE_TOP + position, turn]))
        self.sim.data.set_joint_qvel(vessel.joints[0], np.zeros(6))

    def uprightness(self, vessel: Any) -> float:
        """Cosine between a vessel's axis and the vertical."""
        return float(self.transform_object_to_workspace(vessel)[2, 2])

    def vessel_lost(self, vessel: Any) -> bool:
        """Whether a vessel fell off the table or over, and the hand does not hold it."""
        below = self.transform_object_to_workspace(vessel)[2, 3] < -CAN_RADIUS
        lying = self.uprightness(vessel) < LYING
        return bool(below or (lying and not self.object_in_hand(vessel)))
