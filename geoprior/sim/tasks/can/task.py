"""Can: lift a can that stands anywhere on the middle of the table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.can.config import CanConfig
from geoprior.sim.tasks.timed import TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


@dataclass(frozen=True)
class CanTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: CanConfig
    name: str = "can"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its can."""
        from geoprior.sim.tasks.can.world import CanWorld

        return CanWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Over the can, down about its body, close, up."""
        from geoprior.sim.tasks.can.expert import can_expert
        from geoprior.sim.tasks.can.world import CanWorld

        assert isinstance(world, CanWorld)
        return can_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Not among the paper's five: for pretraining in the same environment."""
    yield TaskSpec(name="can", summary="lift a can off the table", config=CanConfig, factory=CanTask)
