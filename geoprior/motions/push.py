"""Push: the hand goes behind the object and shoves it along the floor to the marker.

The paper's hand goes straight to behind the object, and may go through it. With `from_above` it comes down
behind the object, as arms do; see `geoprior.motions._push_from_above`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import MotionSpec, hookimpl
from geoprior.geometry.interpolate import lerp, slerp
from geoprior.geometry.se3 import cross, make_transform
from geoprior.geometry.seeding import child
from geoprior.motions._push_from_above import PushFromAbove, push_from_above
from geoprior.motions.course import paced, run
from geoprior.motions.timing import EaseOptions, PhaseOptions, approach_steps, eased, ramp, ramp_after
from geoprior.motions.trajectory import Trajectory, way_of_hand
from geoprior.scene.marker import draw_goal, draw_marker
from geoprior.scene.objects import WORLD_UP
from geoprior.scene.ranges import LengthRange, uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]

_NO_PUSH = 1e-9
"""Metres: a shorter push has no direction of its own."""


class PushConfig(EaseOptions, PhaseOptions):
    """Options of `push`."""

    later = EaseOptions.later | {"from_above"}

    gap: LengthRange = Field(
        (0.002, 0.01), description="Between the front of the hand cube and the object, metres."
    )
    from_above: PushFromAbove | None = Field(
        None,
        description="Pushes whose hand comes down behind the object; null: the paper's straight approach.",
    )


@dataclass(frozen=True)
class Push:
    """See `geoprior.hooks.types.Motion`. The gripper stays open, unless `from_above` closes it."""

    config: PushConfig

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan approach and push.

        Raises:
            ConfigError: ``steps`` are too few, or there is no room for the marker.
        """
        own, above = child(rng, "from-above"), self.config.from_above
        if above is not None and own.random() < above.share:
            return self._from_above(above, scene, steps, own)
        ease = self.config.draw_ease(rng)
        moving = approach_steps("push", steps, self.config.approach, 1)
        goal = draw_goal(scene, np.eye(3), rng)
        centre, start = scene.object.centre, scene.hand.transform_hand_to_world
        direction = push_direction(centre, goal[:3, 3])
        distance = support(scene.object.vertices - centre, -direction) + uniform(rng, self.config.gap)
        rotation = push_rotation(direction)
        behind = centre - distance * direction
        times = eased(ramp(moving), ease)
        way = make_transform(slerp(start[:3, :3], rotation, times), lerp(start[:3, 3], behind, times))
        onward = eased(ramp_after(steps - moving), ease)
        shifts: FloatArray = onward[:, None] * (goal[:3, 3] - centre)
        pushed = np.repeat(scene.object.transform_object_to_world[None], steps, axis=0)
        pushed[moving:, :3, 3] += shifts
        marker = draw_marker(scene, goal, rng)
        return Trajectory(
            hands=way_of_hand(
                np.concatenate([way, make_transform(rotation, behind + shifts)]), np.zeros(steps)
            ),
            transforms_object_to_world=pushed,
            marker_points=marker.points,
            marker_surface=marker.surface,
            phases=("approach",) * moving + ("push",) * (steps - moving),
        )

    def _from_above(
        self, options: PushFromAbove, scene: Scene, steps: int, rng: np.random.Generator
    ) -> Trajectory:
        goal = draw_goal(scene, np.eye(3), rng)
        direction = push_direction(scene.object.centre, goal[:3, 3])
        gap, ease = uniform(rng, self.config.gap), self.config.draw_ease(rng)
        stroke = push_from_above(scene, goal, direction, options, gap, rng)
        ran = run("push", paced(stroke.legs, options.pace, rng), steps, ease)
        gripper = ran.gripper.copy()
        gripper[0] = 0.0  # hands are open when an episode begins
        shifts = np.clip((ran.transforms_hand_to_world[:, :3, 3] - stroke.touch) @ direction, 0.0, None)
        pushed = np.repeat(scene.object.transform_object_to_world[None], steps, axis=0)
        down = ran.leg >= stroke.pushing
        pushed[down, :3, 3] += shifts[down, None] * direction
        marker = draw_marker(scene, goal, rng)
        return Trajectory(
            hands=way_of_hand(ran.transforms_hand_to_world, gripper, ran.openness),
            transforms_object_to_world=pushed,
            marker_points=marker.points,
            marker_surface=marker.surface,
            phases=ran.phases,
        )


def push_direction(centre: FloatArray, goal: FloatArray) -> FloatArray:
    """v_push: the horizontal direction from the object's centre to the marker's, as a unit vector.

    The paper's equation leaves the projection's length as it is, which would make d v_push depend on how
    far the push goes; d is a distance here. A push of no distance has +x for its direction.
    """
    across = np.array([goal[0] - centre[0], goal[1] - centre[1], 0.0])
    length = float(np.linalg.norm(across))
    return across / length if length > _NO_PUSH else np.array([1.0, 0.0, 0.0])


def push_rotation(direction: FloatArray) -> FloatArray:
    """R_start = [u_world x v_push, u_world, v_push], (3, 3)."""
    return np.column_stack([cross(WORLD_UP, direction), WORLD_UP, direction])


def support(points: FloatArray, direction: FloatArray) -> float:
    """How far points (P, 3) reach along a unit direction, metres.

    The hand's origin lies on the front face of its cube, and that face is across the direction of the
    push: at this distance and beyond a plane parts the cube from the object.
    """
    return float(np.max(points @ direction))


@hookimpl
def geoprior_motions() -> Iterable[MotionSpec]:
    """One motion."""
    yield MotionSpec(
        name="push",
        summary="go behind the object and push it along the floor to the marker",
        config=PushConfig,
        factory=Push,
    )
