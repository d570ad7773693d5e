"""Push: move a cube to a coloured area without lifting it; both are anywhere on the middle of the table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.push.config import PushConfig
from geoprior.sim.tasks.timed import TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


@dataclass(frozen=True)
class PushTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: PushConfig
    name: str = "push"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its cube and area."""
        from geoprior.sim.tasks.push.world import PushWorld

        return PushWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Down behind the cube, then straight to the area."""
        from geoprior.sim.tasks.push.expert import push_expert
        from geoprior.sim.tasks.push.world import PushWorld

        assert isinstance(world, PushWorld)
        return push_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Task c) of the paper's five."""
    yield TaskSpec(name="push", summary="push a cube to a coloured area", config=PushConfig, factory=PushTask)
