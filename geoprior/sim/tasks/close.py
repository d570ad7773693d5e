"""Close: shut a small door that stands open anywhere on a part of the table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.door import DoorConfig
from geoprior.sim.tasks.timed import TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


class CloseConfig(DoorConfig):
    """Options of the task `close`: those of `door`, and how far the door is open at first.

    With the widest range, the door is in the third camera's view and its panel within every arm's reach.
    """

    range_angle: float = Field(
        0.15, ge=0.0, le=0.15, description="It begins open by 0.45 radians within +- this."
    )
    angle: float = Field(
        0.03, ge=0.01, le=0.1, description="Angle of the hinge below which the door counts as shut, radians."
    )
    sustain: float = Field(
        0.5, ge=0.0, le=5.0, description="Seconds for which success must hold without a break."
    )


@dataclass(frozen=True)
class CloseTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: CloseConfig
    name: str = "close"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its open door."""
        from geoprior.sim.worlds.close import CloseWorld

        return CloseWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """To the panel with closed fingers, push along an arc about the hinge."""
        from geoprior.sim.experts.close import close_expert
        from geoprior.sim.worlds.close import CloseWorld

        assert isinstance(world, CloseWorld)
        return close_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """One of the tasks whose demonstrations serve for pretraining in the same environment."""
    yield TaskSpec(name="close", summary="push a door shut", config=CloseConfig, factory=CloseTask)
