"""Place: put a cube into a low-walled enclosure; both are anywhere on the middle of the table, in any yaw."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.place.config import PlaceConfig
from geoprior.sim.tasks.timed import TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


@dataclass(frozen=True)
class PlaceTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: PlaceConfig
    name: str = "place"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its cube and enclosure."""
        from geoprior.sim.tasks.place.world import PlaceWorld

        return PlaceWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Grasp the cube, over the wall with it, down, open, up."""
        from geoprior.sim.tasks.place.expert import place_expert
        from geoprior.sim.tasks.place.world import PlaceWorld

        assert isinstance(world, PlaceWorld)
        return place_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Task b) of the paper's five."""
    yield TaskSpec(
        name="place", summary="put a cube into an enclosure", config=PlaceConfig, factory=PlaceTask
    )
