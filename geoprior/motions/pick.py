"""Pick: the hand moves to where it can grasp the object, and closes at the very end."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import MotionSpec, hookimpl
from geoprior.motions._grasp import GraspOptions, grasp_position, reach
from geoprior.motions.timing import approach_steps
from geoprior.motions.trajectory import Trajectory, way_of_hand

if TYPE_CHECKING:
    from geoprior.scene.scene import Scene


class PickConfig(GraspOptions):
    """Options of `pick`."""

    closed: int = Field(1, ge=1, description="Last steps, at the grasp pose, with the gripper closed.")


@dataclass(frozen=True)
class Pick:
    """See `geoprior.hooks.types.Motion`. The object stays where it is."""

    config: PickConfig

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan the approach.

        Raises:
            ConfigError: ``steps`` are too few.
        """
        held = self.config.closed - 1
        moving = approach_steps("pick", steps, 1.0, held)
        way = reach(scene, grasp_position(scene, self.config, rng), moving)
        gripper = np.zeros(steps)
        gripper[-self.config.closed :] = 1.0
        return Trajectory(
            hands=way_of_hand(np.concatenate([way, np.repeat(way[-1:], held, axis=0)]), gripper),
            transforms_object_to_world=np.repeat(scene.object.transform_object_to_world[None], steps, axis=0),
            marker_points=None,
            phases=("approach",) * (steps - self.config.closed) + ("grasp",) * self.config.closed,
        )


@hookimpl
def geoprior_motions() -> Iterable[MotionSpec]:
    """One motion."""
    yield MotionSpec(
        name="pick", summary="approach the object and close on it", config=PickConfig, factory=Pick
    )
