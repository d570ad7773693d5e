"""Pile: put a bottle onto a can; both stand anywhere on the middle of the table."""

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


class PileConfig(TimedOptions):
    """Options of the task `pile`.

    With the widest range, bottle and can are in the third camera's view and within every arm's reach. With
    the narrowest, the largest gap still leaves room for both.
    """

    range_x: float = Field(
        0.10, ge=0.0, le=0.10, description="Bottle and can stand within +- this along x, metres."
    )
    range_y: float = Field(
        0.15, ge=0.11, le=0.15, description="Bottle and can stand within +- this along y, metres."
    )
    gap: float = Field(
        0.15, ge=0.14, le=0.17, description="From the bottle's middle to the can's, at least, metres."
    )
    seconds: float = Field(15.0, gt=0.0, le=120.0, description="Time limit of a trial.")
    sustain: float = Field(
        0.5, ge=0.0, le=5.0, description="Seconds for which success must hold without a break."
    )


@dataclass(frozen=True)
class PileTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: PileConfig
    name: str = "pile"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its bottle and can."""
        from geoprior.sim.worlds.pile import PileWorld

        return PileWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Grasp the bottle by its body, over the can with it, down, open, up."""
        from geoprior.sim.experts.pile import pile_expert
        from geoprior.sim.worlds.pile import PileWorld

        assert isinstance(world, PileWorld)
        return pile_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Task d) of the paper's five."""
    yield TaskSpec(name="pile", summary="put a bottle onto a can", config=PileConfig, factory=PileTask)
