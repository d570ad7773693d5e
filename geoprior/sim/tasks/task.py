"""What the program knows of a task. The world behind it is a robosuite environment, built on demand."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


class Task(Protocol):
    """A downstream task."""

    @property
    def name(self) -> str:
        """Registered name."""
        ...

    @property
    def seconds(self) -> float:
        """How long a trial may take."""
        ...

    @property
    def sustain(self) -> float:
        """Seconds for which success must hold without a break before a trial counts."""
        ...

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world: a robosuite environment that places its objects and judges itself.

        Args:
            robot: The arm; a task for more arms has options that say which others stand beside it.
            setting: How it is seen and paced.
        """
        ...

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Pose commands (8 x hands) of one scripted demonstration; the last repeats once they are used up.

        The expert sees the simulator's state: it reads ``world`` when the next command is asked for.

        Args:
            world: Reset to the initial state.
            start: (8 x hands) the hands' pose vectors there.
            rng: For the natural variation of the demonstration.
        """
        ...
