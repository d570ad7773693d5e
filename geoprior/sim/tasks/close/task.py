"""Close: shut a small door that stands open anywhere on a part of the table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.close.config import CloseConfig
from geoprior.sim.tasks.timed import TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


@dataclass(frozen=True)
class CloseTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: CloseConfig
    name: str = "close"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its open door."""
        from geoprior.sim.tasks.close.world import CloseWorld

        return CloseWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """To the panel with closed fingers, push along an arc about the hinge."""
        from geoprior.sim.tasks.close.expert import close_expert
        from geoprior.sim.tasks.close.world import CloseWorld

        assert isinstance(world, CloseWorld)
        return close_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """One of the tasks whose demonstrations serve for pretraining in the same environment."""
    yield TaskSpec(name="close", summary="push a door shut", config=CloseConfig, factory=CloseTask)
