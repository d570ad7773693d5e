"""Pile: a bottle and a can, both standing anywhere on the middle of the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.sim.worlds.placing import draw_two_places
from geoprior.sim.worlds.vessel_world import VesselWorld
from geoprior.sim.worlds.vessels import CAN_HEIGHT, CAN_RADIUS, make_bottle, make_can

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.tasks.pile.config import PileConfig

MIDDLE = np.array([-0.04, 0.0])
"""Middle of the rectangle in the workspace frame, metres: where the third camera sees a whole pile."""

UPRIGHT = np.cos(np.radians(8.0))
"""Cosine between a vessel's axis and the vertical."""

ON_TOP = 0.004
"""Metres by which the bottle's foot may be higher or lower than the can's top."""


class PileWorld(VesselWorld):
    """A bottle to put onto a can.

    Args:
        robot: The arm.
        setting: How it is seen and paced.
        config: Where the two may stand.
    """

    def __init__(self, robot: Robot, setting: Setting, config: PileConfig) -> None:
        self.config = config
        super().__init__(robot, setting)

    def make_objects(self) -> Sequence[Any]:
        """Bottle and can."""
        self.bottle, self.can = make_bottle(), make_can()
        return [self.bottle, self.can]

    def place_objects(self, rng: np.random.Generator) -> None:
        """Both upright in the configured rectangle, ``gap`` apart."""
        bottle, can = draw_two_places(rng, MIDDLE, self.config)
        self.put(self.bottle, np.array([*bottle, 0.0]))
        self.put(self.can, np.array([*can, 0.0]))

    def aim_points(self) -> Mapping[str, FloatArray]:
        """The bottle; see `geoprior.sim.worlds.tabletop.Tabletop.aim_points`."""
        return {"object": self.transform_object_to_workspace(self.bottle)[:3, 3]}

    def bottle_over_can(self) -> FloatArray:
        """(3,) from the middle of the can's top to that of the bottle's foot, workspace axes, metres."""
        bottle, can = (self.transform_object_to_workspace(each) for each in (self.bottle, self.can))
        offset: FloatArray = bottle[:3, 3] - can[:3, 3] - CAN_HEIGHT * can[:3, 2]
        return offset

    def succeeded(self) -> bool:
        """The bottle stands on the can, both upright and at rest, and the gripper does not touch it."""
        return (
            self.bottle_on_can() and self.object_at_rest(self.bottle) and not self.object_in_hand(self.bottle)
        )

    def bottle_on_can(self) -> bool:
        """Whether the bottle's foot is on the can's top and both are upright."""
        offset = self.bottle_over_can()
        on_top = np.linalg.norm(offset[:2]) < CAN_RADIUS and abs(offset[2]) < ON_TOP
        return bool(on_top and min(self.uprightness(each) for each in (self.bottle, self.can)) > UPRIGHT)

    def failure(self) -> str:
        """Bottle or can fell off the table or over, and the hand does not hold it."""
        return "dropped" if any(self.vessel_lost(each) for each in (self.bottle, self.can)) else ""
