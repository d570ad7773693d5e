"""Close: the small door of the task `door`, which an episode sets up open."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.sim.tasks.door.small_door import POST_OFFSET
from geoprior.sim.tasks.door.world import CLEARANCE, DoorWorld
from geoprior.sim.worlds.tabletop import START_POSITION

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.tasks.close.config import CloseConfig

MIDDLE = np.array([-0.17, -0.175])
"""Middle of the rectangle in which the shut door's middle lies, workspace frame, metres."""

FACING = np.radians(145.0)
"""Yaw of the door in the middle of its range: once it is open, it stands about as the shut one of `door`."""

OPEN = 0.45
"""Radians by which the door is open in the middle of its range."""


class CloseWorld(DoorWorld):
    """See `geoprior.sim.tasks.door.world.DoorWorld`; this door is to be shut."""

    config: CloseConfig

    def place_objects(self, rng: np.random.Generator) -> None:
        """Open, anywhere in the configured ranges where the panel is clear of the hand's start."""
        config = self.config
        reach = np.array([config.range_x, config.range_y, np.radians(config.range_yaw), config.range_angle])
        middle = np.array([*MIDDLE, FACING, OPEN])
        x, y, yaw, angle = middle + rng.uniform(-reach, reach)
        while _distance_to_panel(START_POSITION[:2], np.array([x, y]), yaw, angle) < CLEARANCE:
            x, y, yaw, angle = middle + rng.uniform(-reach, reach)
        self.put_door(np.array([x, y]), yaw, angle)

    def succeeded(self) -> bool:
        """The door is open by less than ``angle``."""
        return self.hinge_angle() < self.config.angle


def _distance_to_panel(point: FloatArray, middle: FloatArray, yaw: float, angle: float) -> float:
    """Metres, seen from above, from a point (2,) to the open panel, from its hinge to its free edge."""
    hinge = middle + POST_OFFSET * np.array([np.cos(yaw), np.sin(yaw)])
    panel = -2.0 * POST_OFFSET * np.array([np.cos(yaw + angle), np.sin(yaw + angle)])
    share = np.clip((point - hinge) @ panel / (panel @ panel), 0.0, 1.0)
    return float(np.linalg.norm(point - hinge - share * panel))
