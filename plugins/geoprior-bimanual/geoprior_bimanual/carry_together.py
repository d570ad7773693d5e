"""Carry together: two hands take an object from opposite sides, bring it to the marker, and let go."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import MotionSpec, hookimpl
from geoprior.geometry.interpolate import rotations_about
from geoprior.geometry.se3 import invert
from geoprior.motions.place import transport
from geoprior.motions.timing import shared_out
from geoprior.motions.trajectory import HandWay, Trajectory
from geoprior.scene.marker import draw_goal, marker_points
from geoprior.scene.objects import WORLD_UP
from geoprior.scene.ranges import uniform
from geoprior_bimanual import HANDS
from geoprior_bimanual.grasps import GraspOptions, draw_yaw, opposite_grasps, straight

if TYPE_CHECKING:
    from geoprior.scene.scene import Scene


class CarryTogetherConfig(GraspOptions):
    """Options of `carry-together`."""

    approach: float = Field(
        0.5, gt=0.0, lt=1.0, description="Share of the steps until both hands hold the object."
    )


@dataclass(frozen=True)
class CarryTogether:
    """See `geoprior.hooks.types.Motion`. Both grippers close and open at the same steps."""

    config: CarryTogetherConfig

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan approach, transport and release.

        Raises:
            ConfigError: ``steps`` are too few, or there is no room for the marker.
        """
        share = self.config.approach
        moving, carrying = shared_out("carry-together", steps, [share, 1.0 - share])
        start, yaw = scene.object.transform_object_to_world, draw_yaw(self.config, rng)
        goal = draw_goal(scene, rotations_about(WORLD_UP, np.array([yaw]))[0], rng)
        grasps = opposite_grasps(scene, self.config, rng)
        carried = transport(start, start[:3, 3], goal[:3, 3], yaw, uniform(rng, self.config.lift), carrying)
        gripper = np.zeros(steps)
        gripper[moving - 1 : -1] = 1.0
        ways = {
            name: [
                straight(scene.hands[name].transform_hand_to_world, grasp, moving),
                carried @ (invert(start) @ grasp),
            ]
            for name, grasp in grasps.items()
        }
        return Trajectory(
            hands={name: HandWay(np.concatenate(way), gripper) for name, way in ways.items()},
            transforms_object_to_world=np.concatenate([np.repeat(start[None], moving, axis=0), carried]),
            marker_points=marker_points(scene, goal, rng),
            phases=("approach",) * (moving - 1) + ("grasp",) + ("transport",) * (carrying - 1) + ("release",),
        )


@hookimpl
def geoprior_motions() -> Iterable[MotionSpec]:
    """One motion."""
    yield MotionSpec(
        name="carry-together",
        summary="two hands carry the object to the marker",
        config=CarryTogetherConfig,
        factory=CarryTogether,
        hands=HANDS,
    )
