"""Stack: put a cube onto another; both lie anywhere on the middle of the table, in any yaw."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import TaskSpec, hookimpl
from geoprior.sim.tasks.timed import GoalOptions, TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


class StackConfig(GoalOptions):
    """Options of the task `stack`; the goal is the other cube."""

    # Room for an open finger between the cubes, whatever their yaws.
    gap: float = Field(
        0.13, ge=0.11, le=0.20, description="From one cube's centre to the other's, at least, metres."
    )
    seconds: float = Field(15.0, gt=0.0, le=120.0, description="Time limit of a trial.")
    sustain: float = Field(
        0.5, ge=0.0, le=5.0, description="Seconds for which success must hold without a break."
    )


@dataclass(frozen=True)
class StackTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: StackConfig
    name: str = "stack"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world with its two cubes."""
        from geoprior.sim.worlds.stack import StackWorld

        return StackWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Grasp one cube, over the other with it, down, open, up."""
        from geoprior.sim.experts.stack import stack_expert
        from geoprior.sim.worlds.stack import StackWorld

        assert isinstance(world, StackWorld)
        return stack_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """Not among the paper's five: for pretraining in the same environment."""
    yield TaskSpec(
        name="stack", summary="put a cube onto another cube", config=StackConfig, factory=StackTask
    )
