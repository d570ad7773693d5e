"""An arm at the table: which one, what its hand is called, and where it stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior.scene.hand import HAND

if TYPE_CHECKING:
    from geoprior.sim.robots.robot import Robot


@dataclass(frozen=True)
class Arm:
    """An arm of a world.

    Attributes:
        robot: What is known of the arm.
        hand: Name of its hand, and of the camera in it.
        base: (x, y) metres, workspace axes: how far its base stands from the usual place, which is behind the
            middle of the table's edge at -x.
        start: (x, y, z) metres, workspace frame: the middle of where its hand starts an episode.
    """

    robot: Robot
    hand: str = HAND
    base: tuple[float, float] = (0.0, 0.0)
    start: tuple[float, float, float] = (-0.07, 0.0, 0.26)
