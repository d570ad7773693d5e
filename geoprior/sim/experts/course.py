"""A demonstration under way: an expert that goes, looks how it has come out, and goes on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from geoprior.sim.experts.path import Waypoint, commands_in, follow

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.worlds.tabletop import Tabletop

STILL = 0.02
"""Metres a second: a hand that was slower than this for two tenths of a second is still."""


class Course:
    """Yields commands and remembers the last one.

    robosuite's controller has no integral part, and after a long move the arms swing about their goal: where
    millimetres count, an expert rests until the hand is still, and then aims again.

    Args:
        world: Reset to the initial state.
        start: (8,) pose vector to begin at.
    """

    def __init__(self, world: Tabletop, start: NDArray[np.float32]) -> None:
        self._world = world
        self.last = start

    def go(self, *waypoints: Waypoint) -> Iterator[NDArray[np.float32]]:
        """Commands (8,) through the waypoints."""
        for command in follow(self.last, waypoints, self._world.control_freq):
            self.last = command
            yield command

    def rest(self, patience: int) -> Iterator[NDArray[np.float32]]:
        """Repeat the last command until the hand is still, for ``patience`` tenths of a second at most."""
        rate = self._world.control_freq
        before, still = self._hand(), 0
        for _ in range(commands_in(patience, rate)):
            yield self.last
            now = self._hand()
            still = still + 1 if rate * np.linalg.norm(now - before) < STILL else 0
            before = now
            if still == commands_in(2, rate):
                return

    def target(self) -> FloatArray:
        """(3,) where the hand was sent last, workspace frame, metres."""
        return self.last[:3].astype(np.float64)

    def correction(self) -> FloatArray:
        """(3,) metres: half of what the hand lacks of where it was sent, to be added to the next command.

        All of it would be too much while the hand still swings.
        """
        correction: FloatArray = 0.5 * (self.last[:3] - self._hand())
        return correction

    def _hand(self) -> FloatArray:
        return self._world.transform_hand_to_workspace()[:3, 3]
