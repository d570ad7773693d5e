"""Cable: lay the plug of a cable into a coloured area; both are anywhere on the middle of the table."""

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


class CableConfig(TimedOptions):
    """Options of the task `cable`.

    With the widest range, cable and area are in the third camera's view and within every arm's reach. With
    the narrowest, there is still room for the largest area, gap and bend.
    """

    range_x: float = Field(
        0.09, ge=0.0, le=0.09, description="Plug and area lie within +- this along x, metres."
    )
    range_y: float = Field(
        0.14, ge=0.10, le=0.14, description="Plug and area lie within +- this along y, metres."
    )
    gap: float = Field(
        0.12, ge=0.10, le=0.16, description="From the plug's middle to the area's, at least, metres."
    )
    bend: float = Field(
        80.0,
        ge=0.0,
        le=120.0,
        description="The cable turns by no more than this from one end to the other, degrees.",
    )
    radius: float = Field(
        0.04, ge=0.02, le=0.05, description="Of the area; the plug's middle must lie over it, metres."
    )
    seconds: float = Field(15.0, gt=0.0, le=120.0, description="Time limit of a trial.")
    sustain: float = Field(
        0.5, ge=0.0, le=5.0, description="Seconds for which success must hold without a break."
    )


@dataclass(frozen=True)
class CableTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: CableConfig
    name: str = "cable"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its cable and area."""
        from geoprior.sim.worlds.cable import CableWorld

        return CableWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Grasp the plug, over the area with it, down, open, up."""
        from geoprior.sim.experts.cable import cable_expert
        from geoprior.sim.worlds.cable import CableWorld

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
