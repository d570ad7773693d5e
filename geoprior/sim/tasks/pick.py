"""Pick: lift a cube that lies anywhere on the middle of the table, in any yaw."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.timed import TimedOptions, TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


class PickConfig(TimedOptions):
    """Options of the task `pick`."""

    range_x: float = Field(0.10, ge=0.0, le=0.15, description="The cube lies within +- this along x, metres.")
    range_y: float = Field(0.15, ge=0.0, le=0.20, description="The cube lies within +- this along y, metres.")
    lift: float = Field(
        0.05, ge=0.02, le=0.15, description="Height of the cube's underside that counts, metres."
    )


@dataclass(frozen=True)
class PickTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: PickConfig
    name: str = "pick"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its cube."""
        from geoprior.sim.worlds.pick import PickWorld

        return PickWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Over the cube, down, close, up."""
        from geoprior.sim.experts.pick import pick_expert
        from geoprior.sim.worlds.pick import PickWorld

        assert isinstance(world, PickWorld)
        return pick_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Task a) of the paper's five."""
    yield TaskSpec(name="pick", summary="lift a cube off the table", config=PickConfig, factory=PickTask)
