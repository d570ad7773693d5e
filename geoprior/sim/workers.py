"""What a process builds once and keeps: environments, which take a second each to build."""

from __future__ import annotations

import gc
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.sim.backend import require_simulation

if TYPE_CHECKING:
    from geoprior.sim.environment import Environment

PLAIN = Choice(name="plain")


@dataclass(frozen=True)
class Setup:
    """What is simulated, by name: a unit of work carries it to whatever process does the work.

    Attributes:
        robot: Choice of the arm.
        task: Choice of the task.
        cameras: Lenses and size of the frames.
        look: Choice of the look.
    """

    robot: Choice
    task: Choice
    cameras: CamerasConfig
    look: Choice = field(default=PLAIN)


def environment(setup: Setup, control_rate: int) -> Environment:
    """This process's environment for a setup; built at the first call.

    Raises:
        ConfigError: A name or an option is unknown, or the rate does not divide the physics rate.
        MachineError: No GL, or robosuite cannot be used.
    """
    return environments(setup, control_rate, 1)[0]


def environments(setup: Setup, control_rate: int, count: int) -> list[Environment]:
    """So many environments for a setup, which share their rendering contexts.

    Raises:
        GeopriorError: As `environment`.
    """
    require_simulation()
    found = plugins()
    made = _kept(
        found.resolve("robot", setup.robot).model_dump_json(),
        found.resolve("task", setup.task).model_dump_json(),
        found.resolve("look", setup.look).model_dump_json(),
        setup.cameras.model_dump_json(),
        control_rate,
    )
    while len(made) < count:
        made.append(_build(setup, control_rate, made))
    return made[:count]


@lru_cache(maxsize=2)
def _kept(robot: str, task: str, look: str, cameras: str, control_rate: int) -> list[Environment]:  # noqa: ARG001
    """The environments of one setup, to be filled."""
    return []


def _build(setup: Setup, control_rate: int, siblings: list[Environment]) -> Environment:
    from geoprior.sim.environment import Environment
    from geoprior.sim.setting import Setting

    if not siblings:
        # robosuite's objects refer to each other, and Python does not see the 100 MB that they hold.
        gc.collect()
    found = plugins()
    return Environment(
        found.build("robot", setup.robot),
        found.build("task", setup.task),
        Setting(setup.cameras, control_rate, found.build("look", setup.look)),
        siblings[0].eyes if siblings else None,
    )
