"""Can: one can, standing anywhere on the middle of the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.sim.worlds.vessel_world import VesselWorld
from geoprior.sim.worlds.vessels import CAN_HEIGHT, CAN_RADIUS, make_can

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.tasks.can.config import CanConfig


class CanWorld(VesselWorld):
    """A can to lift.

    Args:
        robot: The arm.
        setting: How it is seen and paced.
        config: The can's range and how high to lift it.
    """

    def __init__(self, robot: Robot, setting: Setting, config: CanConfig) -> None:
        self.config = config
        super().__init__(robot, setting)

    def make_objects(self) -> Sequence[Any]:
        """The can alone."""
        self.can = make_can()
        return [self.can]

    def place_objects(self, rng: np.random.Generator) -> None:
        """Upright, anywhere in the configured rectangle."""
        reach = np.array([self.config.range_x, self.config.range_y])
        self.put_can(np.array([*rng.uniform(-reach, reach), 0.0]))

    def put_can(self, position: FloatArray, tilt: float = 0.0) -> None:
        """Set the can up, at rest.

        Args:
            position: (3,) of the middle of its foot in the workspace frame, metres.
            tilt: Radians by which it leans about +x.
        """
        self.put(self.can, position, tilt)

    def can_position(self) -> FloatArray:
        """(3,) middle of the can's foot in the workspace frame, metres."""
        position: FloatArray = self.transform_object_to_workspace(self.can)[:3, 3]
        return position

    def aim_points(self) -> Mapping[str, FloatArray]:
        """The can; see `geoprior.sim.worlds.tabletop.Tabletop.aim_points`."""
        return {"object": self.can_position()}

    def can_clearance(self) -> float:
        """Height of the can's lowest point over the table, metres: of a rim, whichever way the can leans."""
        uprightness, foot = self.transform_object_to_workspace(self.can)[2, 2:]
        lower_end = foot + min(0.0, CAN_HEIGHT * uprightness)
        return float(lower_end - CAN_RADIUS * np.sqrt(max(0.0, 1.0 - uprightness**2)))

    def succeeded(self) -> bool:
        """All of the can is ``lift`` above the table."""
        return self.can_clearance() > self.config.lift

    def failure(self) -> str:
        """The can fell off the table or over, and the hand does not hold it."""
        return "dropped" if self.vessel_lost(self.can) else ""
