"""The scripted pick: over the cube, down, close, up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from geoprior.sim.experts.grasp import draw_grasp
from geoprior.sim.experts.path import Waypoint, follow

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.sim.tasks.pick.world import PickWorld


def pick_expert(
    world: PickWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """One demonstration; see `geoprior.sim.tasks.task.Task.expert`.

    What varies from one to the next, beside the grasp: where the cube is lifted to, and the pauses.
    """
    grasp = draw_grasp(world, start, rng)
    lifted = grasp.position + np.array([*rng.normal(0.0, 0.01, 2), rng.uniform(0.12, 0.17)])
    waypoints = [*grasp.waypoints(rng), Waypoint(lifted, grasp.rotation, 1.0, grasp.speed, wait=3)]
    return follow(start, waypoints, world.control_freq)
