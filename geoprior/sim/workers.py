"""What a process builds once and keeps: environments, which take seconds to build."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice

if TYPE_CHECKING:
    from geoprior.sim.environment import Environment


def environment(
    robot: Choice, task: Choice, cameras: CamerasConfig, control_rate: int, controller: str = "exact"
) -> Environment:
    """The environment of this process for these choices; built at the first call.

    Raises:
        ConfigError: A name or an option is unknown, or the rate does not divide the physics rate.
        MachineError: No GL, or robosuite cannot be used.
    """
    found = plugins()
    return _environment(
        found.resolve("robot", robot).model_dump_json(),
        found.resolve("task", task).model_dump_json(),
        cameras.model_dump_json(),
        control_rate,
        controller,
    )


@lru_cache(maxsize=2)
def _environment(robot: str, task: str, cameras: str, control_rate: int, controller: str) -> Environment:
    from geoprior.sim.environment import Environment

    return Environment(
        plugins().build("robot", Choice.model_validate_json(robot)),
        plugins().build("task", Choice.model_validate_json(task)),
        CamerasConfig.model_validate_json(cameras),
        control_rate,
        controller,
    )
