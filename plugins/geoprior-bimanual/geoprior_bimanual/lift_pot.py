"""Lift pot: two arms take a pot by its handles and lift it, level. After robosuite's TwoArmLift."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import TaskSpec, hookimpl
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.sim.tasks.timed import TimedOptions, TimedTask

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.worlds.tabletop import Tabletop


class LiftPotConfig(TimedOptions):
    """Options of the task `lift-pot`."""

    partner: str | None = Field(
        None, description="Registered name of the arm on the right; null takes the run's `robot` twice."
    )
    range_x: float = Field(0.05, ge=0.0, le=0.08, description="The pot lies within +- this along x, metres.")
    range_y: float = Field(0.05, ge=0.0, le=0.08, description="The pot lies within +- this along y, metres.")
    range_yaw: float = Field(
        20.0, ge=0.0, le=30.0, description="The line across its handles lies within +- this of y, degrees."
    )
    lift: float = Field(
        0.05, ge=0.02, le=0.12, description="Height of the pot's lowest corner that counts, metres."
    )
    tilt: float = Field(
        15.0, gt=0.0, le=45.0, description="The pot may lean by up to this when it is lifted, degrees."
    )


@dataclass(frozen=True)
class LiftPotTask(TimedTask):
    """See `geoprior.sim.tasks.task.Task`."""

    config: LiftPotConfig
    name: str = "lift-pot"

    def make(self, robot: Robot, setting: Setting) -> Tabletop:
        """Build the world: the run's arm on the left, its partner on the right, driven in the same way.

        Raises:
            ConfigError: There is no arm of the partner's name.
        """
        from geoprior_bimanual.pot_world import PotWorld

        partner = self.config.partner
        other: Robot = robot if partner is None else plugins().build("robot", Choice(name=partner))
        return PotWorld(robot, replace(other, controller=robot.controller), setting, self.config)

    def expert(
        self, world: Tabletop, start: NDArray[np.float32], rng: np.random.Generator
    ) -> Iterator[NDArray[np.float32]]:
        """Over the handles, down, close, up; both hands at a time."""
        from geoprior_bimanual.pot_expert import pot_expert
        from geoprior_bimanual.pot_world import PotWorld

        assert isinstance(world, PotWorld)
        return pot_expert(world, start, rng)


@hookimpl
def geoprior_tasks() -> Iterable[TaskSpec]:
    """One task."""
    yield TaskSpec(
        name="lift-pot",
        summary="two arms lift a pot by its handles",
        config=LiftPotConfig,
        factory=LiftPotTask,
    )
