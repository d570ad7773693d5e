"""Door: pull a small door open that stands anywhere on a part of the table."""

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


class DoorConfig(TimedOptions):
    """Options of the task `door`.

    With the widest range, the door is in the third camera's view and its handle within every arm's reach.
    """

    range_x: float = Field(
        0.08, ge=0.0, le=0.08, description="The door stands within +- this along x, metres."
    )
    range_y: float = Field(
        0.075, ge=0.0, le=0.075, description="The door stands within +- this along y, metres."
    )
    range_yaw: float = Field(27.0, ge=0.0, le=27.0, description="It is turned within +- this, degrees.")
    angle: float = Field(0.3, ge=0.1, le=0.4, description="Angle of the hinge that counts as open, radians.")
    seconds: float = Field(15.0, gt=0.0, le=120.0, description="Time limit of a trial.")


@dataclass(frozen=True)
class DoorTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: DoorConfig
    name: str = "door"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its door."""
        from geoprior.sim.worlds.door import DoorWorld

        return DoorWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """To the handle, close, pull along an arc about the hinge."""
        from geoprior.sim.experts.door import door_expert
        from geoprior.sim.worlds.door import DoorWorld

        assert isinstance(world, DoorWorld)
        return door_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Task e) of the paper's five."""
    yield TaskSpec(name="door", summary="pull a door open", config=DoorConfig, factory=DoorTask)
