"""Pick: the hand moves to where it can grasp the object, and closes at the very end.

Or, with `from_above`, as arms do: over the object, down, close, and perhaps up with it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import MotionSpec, hookimpl
from geoprior.geometry.se3 import invert
from geoprior.geometry.seeding import child
from geoprior.motions._from_above import GraspFromAbove, grasp_from_above, moved
from geoprior.motions._grasp import GraspOptions, grasp_position, reach
from geoprior.motions.course import closed, moving, paced, run, waiting
from geoprior.motions.timing import approach_steps
from geoprior.motions.trajectory import Trajectory, way_of_hand
from geoprior.scene.objects import WORLD_UP
from geoprior.scene.ranges import DistanceRange, uniform

if TYPE_CHECKING:
    from geoprior.scene.scene import Scene


_REST = 0.3
"""Nominal seconds for which the object is held up."""


class PickFromAbove(GraspFromAbove):
    """A pick from above."""

    lift: DistanceRange = Field(
        (0.0, 0.0), description="In the end the object is lifted by this; where it is 0 it stays, metres."
    )


class PickConfig(GraspOptions):
    """Options of `pick`."""

    later = GraspOptions.later | {"from_above"}

    closed: int = Field(1, ge=1, description="Last steps, at the grasp pose, with the gripper closed.")
    from_above: PickFromAbove | None = Field(
        None, description="Picks from above, between the fingers; null: the paper's, outside the object."
    )


@dataclass(frozen=True)
class Pick:
    """See `geoprior.hooks.types.Motion`. The object stays where it is, unless it is lifted."""

    config: PickConfig

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan the approach.

        Raises:
            ConfigError: ``steps`` are too few.
        """
        own, above = child(rng, "from-above"), self.config.from_above
        if above is not None and own.random() < above.share:
            return self._from_above(above, scene, steps, own)
        held = self.config.closed - 1
        approach = approach_steps("pick", steps, 1.0, held)
        way = reach(scene, grasp_position(scene, self.config, rng), approach, self.config.draw_ease(rng))
        gripper = np.zeros(steps)
        gripper[-self.config.closed :] = 1.0
        return Trajectory(
            hands=way_of_hand(np.concatenate([way, np.repeat(way[-1:], held, axis=0)]), gripper),
            transforms_object_to_world=np.repeat(scene.object.transform_object_to_world[None], steps, axis=0),
            marker_points=None,
            phases=("approach",) * (steps - self.config.closed) + ("grasp",) * self.config.closed,
        )

    def _from_above(
        self, options: PickFromAbove, scene: Scene, steps: int, rng: np.random.Generator
    ) -> Trajectory:
        grasp = grasp_from_above(scene, options, self.config.slenderness, rng)
        lifted = moved(grasp.pose, uniform(rng, options.lift) * WORLD_UP)
        legs = list(grasp.legs)
        if options.lift[1] > 0.0:
            legs.append(closed(moving("lift", grasp.pose, lifted), carries=True))
            legs.append(closed(waiting("lift", lifted, _REST), carries=True))
        ran = run("pick", paced(legs, options.pace, rng), steps, self.config.draw_ease(rng))
        start = scene.object.transform_object_to_world
        carries = np.array([leg.carries for leg in legs])[ran.leg]
        carried = ran.transforms_hand_to_world @ invert(grasp.pose) @ start
        return Trajectory(
            hands=way_of_hand(ran.transforms_hand_to_world, ran.gripper, ran.openness, grasp.grip),
            transforms_object_to_world=np.where(carries[:, None, None], carried, start),
            marker_points=None,
            phases=ran.phases,
        )


@hookimpl
def geoprior_motions() -> Iterable[MotionSpec]:
    """One motion."""
    yield MotionSpec(
        name="pick", summary="approach the object and close on it", config=PickConfig, factory=Pick
    )
