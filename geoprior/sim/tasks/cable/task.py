"""Cable: lay the plug of a cable into a coloured area; both are anywhere on the middle of the table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.cable.config import CableConfig
from geoprior.sim.tasks.timed import TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


@dataclass(frozen=True)
class CableTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: CableConfig
    name: str = "cable"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its cable and area."""
        from geoprior.sim.tasks.cable.world import CableWorld

        return CableWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Grasp the plug, over the area with it, down, open, up."""
        from geoprior.sim.tasks.cable.expert import cable_expert
        from geoprior.sim.tasks.cable.world import CableWorld

        assert isinstance(world, CableWorld)
        return cable_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """One of the tasks whose demonstrations serve for pretraining in the same environment."""
    yield TaskSpec(
        name="cable",
        summary="lay a cable's plug into a coloured area",
        config=CableConfig,
        factory=CableTask,
    )
