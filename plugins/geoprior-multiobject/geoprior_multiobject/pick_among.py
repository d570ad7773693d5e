"""Pick among distractors: several objects stand about, and the hand goes for the one that it points at."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import MotionSpec, hookimpl
from geoprior.motions.timing import shared_out
from geoprior.motions.trajectory import Trajectory, way_of_hand
from geoprior.scene.config import OtherConfig
from geoprior.scene.marker import marker_points
from geoprior_multiobject.above import AboveOptions, grasp_above, over_and_down

if TYPE_CHECKING:
    from geoprior.scene.scene import Scene


class PickAmongConfig(AboveOptions):
    """Options of `pick-among`."""

    distractors: int = Field(
        2, ge=1, le=20, description="Further objects in the scene, which are left alone."
    )
    distractor: OtherConfig = Field(
        default=OtherConfig(distance=(0.12, 0.3), gap=0.06), description="What they are and where they rest."
    )
    marked: bool = Field(
        default=False, description="Whether the marker is drawn around the object that is meant."
    )
    over: float = Field(
        0.6, gt=0.0, lt=1.0, description="Share of the steps until the hand is above the object."
    )


@dataclass(frozen=True)
class PickAmong:
    """See `geoprior.hooks.types.Motion`. Nothing moves but the hand, which closes at the very end."""

    config: PickAmongConfig

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan the approach.

        Raises:
            ConfigError: ``steps`` are too few.
        """
        config, rest = self.config, scene.object.transform_object_to_world
        over, down = shared_out("pick-among", steps, [config.over, 1.0 - config.over])
        way = over_and_down(scene, grasp_above(scene, config, rng), config.clearance, over, down)
        gripper = np.zeros(steps)
        gripper[-1] = 1.0
        return Trajectory(
            hands=way_of_hand(way, gripper),
            transforms_object_to_world=np.repeat(rest[None], steps, axis=0),
            marker_points=marker_points(scene, rest, rng) if config.marked else None,
            phases=("approach",) * over + ("descent",) * (down - 1) + ("grasp",),
        )


def distractors(config: PickAmongConfig) -> dict[str, OtherConfig]:
    """The further objects, by name."""
    return {f"distractor-{number + 1}": config.distractor for number in range(config.distractors)}


@hookimpl
def geoprior_motions() -> Iterable[MotionSpec]:
    """One motion."""
    yield MotionSpec(
        name="pick-among",
        summary="approach one of several objects from above and close on it",
        config=PickAmongConfig,
        factory=PickAmong,
        others=distractors,
    )
