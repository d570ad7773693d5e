"""Pile: put a bottle onto a can; both stand anywhere on the middle of the table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.pile.config import PileConfig
from geoprior.sim.tasks.timed import TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


@dataclass(frozen=True)
class PileTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: PileConfig
    name: str = "pile"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its bottle and can."""
        from geoprior.sim.tasks.pile.world import PileWorld

        return PileWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Grasp the bottle by its body, over the can with it, down, open, up."""
        from geoprior.sim.tasks.pile.expert import pile_expert
        from geoprior.sim.tasks.pile.world import PileWorld

        assert isinstance(world, PileWorld)
        return pile_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Task d) of the paper's five."""
    yield TaskSpec(name="pile", summary="put a bottle onto a can", config=PileConfig, factory=PileTask)
