"""Where the checks of robots, tasks and looks take place: small simulated worlds, built once."""

from __future__ import annotations

from functools import lru_cache
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from geoprior.authoring.conformance.material import builtins
from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice

if TYPE_CHECKING:
    from geoprior.hooks.types import Spec
    from geoprior.sim.environment import Environment

CAMERAS = CamerasConfig(height=48, width=48)
RATE = 10
"""Commands a second."""

_STAND_IN = {"robot": "ur5e", "task": "pick", "look": "plain"}
"""What stands beside the spec that is checked."""


@lru_cache(maxsize=2)
def world_with(spec: Spec | None = None) -> Environment:
    """An environment in which one of robot, task and look is the spec's, with its default options.

    Raises:
        MachineError: No GL, or robosuite cannot be used.
    """
    from geoprior.sim.environment import Environment
    from geoprior.sim.setting import Setting

    parts = {kind: builtins().build(kind, Choice(name=name)) for kind, name in _STAND_IN.items()}
    if spec is not None:
        parts[spec.kind] = spec.factory(spec.config())
    return Environment(parts["robot"], parts["task"], Setting(CAMERAS, RATE, parts["look"]))


def states(env: Environment, seed: int, steps: int = 20) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Joint positions and velocities (steps + 1, D) while the expert acts from an initial state."""
    env.reset(seed)
    data = env.world.sim.data
    seen = [np.concatenate([data.qpos, data.qvel])]
    for command in islice(env.expert(seed=0), steps):
        env.step(command)
        seen.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(seen)


def demonstrate(env: Environment, limit: int | None = None) -> str | None:
    """Have the expert act from where the environment was reset to, for so many steps at most.

    Returns:
        The judge's verdict: empty for success, a reason of failure, or None where it gave none.

    Raises:
        UnstablePhysicsError: The simulation broke.
    """
    from geoprior.sim.judge import Judge

    judge, verdict = Judge(env), None
    for command in islice(env.expert(0), limit):
        env.step(command)
        verdict = judge.look()
        if verdict is not None:
            break
    return verdict


def frames(env: Environment, seed: int) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.uint8]]]:
    """The first frames of an episode, by camera."""
    env.reset(seed)
    return dict(env.render())
