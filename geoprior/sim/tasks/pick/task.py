"""Pick: lift a cube that lies anywhere on the middle of the table, in any yaw."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.pick.config import PickConfig
from geoprior.sim.tasks.timed import TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


@dataclass(frozen=True)
class PickTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: PickConfig
    name: str = "pick"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its cube."""
        from geoprior.sim.tasks.pick.world import PickWorld

        return PickWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Over the cube, down, close, up."""
        from geoprior.sim.tasks.pick.expert import pick_expert
        from geoprior.sim.tasks.pick.world import PickWorld

        assert isinstance(world, PickWorld)
        return pick_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Task a) of the paper's five."""
    yield TaskSpec(name="pick", summary="lift a cube off the table", config=PickConfig, factory=PickTask)
