"""Stack: put a cube onto another; both lie anywhere on the middle of the table, in any yaw."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.stack.config import StackConfig
from geoprior.sim.tasks.timed import TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


@dataclass(frozen=True)
class StackTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: StackConfig
    name: str = "stack"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its two cubes."""
        from geoprior.sim.tasks.stack.world import StackWorld

        return StackWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Grasp one cube, over the other with it, down, open, up."""
        from geoprior.sim.tasks.stack.expert import stack_expert
        from geoprior.sim.tasks.stack.world import StackWorld

        assert isinstance(world, StackWorld)
        return stack_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Not among the paper's five: for pretraining in the same environment."""
    yield TaskSpec(
        name="stack", summary="put a cube onto another cube", config=StackConfig, factory=StackTask
    )
