"""Door: pull a small door open that stands anywhere on a part of the table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.door.config import DoorConfig
from geoprior.sim.tasks.timed import TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


@dataclass(frozen=True)
class DoorTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: DoorConfig
    name: str = "door"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its door."""
        from geoprior.sim.tasks.door.world import DoorWorld

        return DoorWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """To the handle, close, pull along an arc about the hinge."""
        from geoprior.sim.tasks.door.expert import door_expert
        from geoprior.sim.tasks.door.world import DoorWorld

        assert isinstance(world, DoorWorld)
        return door_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Task e) of the paper's five."""
    yield TaskSpec(name="door", summary="pull a door open", config=DoorConfig, factory=DoorTask)
