"""Can: lift a can that stands anywhere on the middle of the table."""

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


class CanConfig(TimedOptions):
    """Options of the task `can`.

    With the widest range, the can is in the third camera's view and within every arm's reach.
    """

    range_x: float = Field(
        0.10, ge=0.0, le=0.10, description="The can stands within +- this along x, metres."
    )
    range_y: float = Field(
        0.15, ge=0.0, le=0.15, description="The can stands within +- this along y, metres."
    )
    lift: float = Field(
        0.05, ge=0.02, le=0.10, description="Height of the can's lowest point that counts, metres."
    )


@dataclass(frozen=True)
class CanTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: CanConfig
    name: str = "can"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its can."""
        from geoprior.sim.worlds.can import CanWorld

        return CanWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Over the can, down about its body, close, up."""
        from geoprior.sim.experts.can import can_expert
        from geoprior.sim.worlds.can import CanWorld

        assert isinstance(world, CanWorld)
        return can_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Not among the paper's five: for pretraining in the same environment."""
    yield TaskSpec(name="can", summary="lift a can off the table", config=CanConfig, factory=CanTask)
