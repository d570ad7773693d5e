"""Pick: lift a cube that lies anywhere on the middle of the table, in any yaw."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import TaskSpec, hookimpl
from geoprior.options import Options

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.geometry.camera import CamerasConfig
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.worlds.tabletop import Tabletop


class PickConfig(Options):
    """Options of the task `pick`."""

    range_x: float = Field(0.10, ge=0.0, le=0.15, description="The cube lies within +- this along x, metres.")
    range_y: float = Field(0.15, ge=0.0, le=0.20, description="The cube lies within +- this along y, metres.")
    lift: float = Field(
        0.05, ge=0.02, le=0.15, description="Height of the cube's underside that counts, metres."
    )
    seconds: float = Field(10.0, gt=0.0, le=120.0, description="Time limit of a trial.")
    sustain: float = Field(
        0.2, ge=0.0, le=5.0, description="Seconds for which the cube must stay up before it counts."
    )


@dataclass(frozen=True)
class PickTask:
    """See `geoprior.sim.tasks.task.Task`."""

    config: PickConfig
    name: str = "pick"

    @property
    def seconds(self) -> float:
        """Time limit of a trial."""
        return self.config.seconds

    @property
    def sustain(self) -> float:
        """Seconds for which the cube must stay up."""
        return self.config.sustain

    def make(self, robot: Robot, cameras: CamerasConfig, control_rate: int) -> Tabletop:
        """Build the world with its cube."""
        from geoprior.sim.worlds.pick import PickWorld

        return PickWorld(robot, cameras, control_rate, self.config)

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
