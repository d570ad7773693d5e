"""My-plugin: bring the finger tips to a ball in the air, as a task of geoprior's."""

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


class MyPluginConfig(TimedOptions):
    """Options of the task, beside its time limit and how long success must hold."""

    seconds: float = Field(6.0, gt=0.0, le=120.0, description="Time limit of a trial.")
    radius: float = Field(0.025, gt=0.01, le=0.05, description="Of the ball, metres.")


@dataclass(frozen=True)
class MyPlugin(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: MyPluginConfig
    name: str = "my-plugin"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world; robosuite is imported here and not before."""
        from geoprior.authoring.scaffold.templates.task._world import MyPluginWorld

        return MyPluginWorld(robot, setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Commands of one scripted demonstration."""
        from geoprior.authoring.scaffold.templates.task._world import MyPluginWorld, expert

        assert isinstance(world, MyPluginWorld)
        return expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """What this package adds."""
    yield TaskSpec(
        name="my-plugin",
        summary="bring the finger tips to a ball in the air",
        config=MyPluginConfig,
        factory=MyPlugin,
    )
