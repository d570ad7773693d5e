"""Place: grasp the object as `pick` does, carry it in an arc to the marker, and let go.

The paper draws the marker by "randomly rotating the object" and wants the placed object to cover it seen
from above. Here R_rand turns about world z: the object then rests on the same face at the goal as at the
start, so that it stands on the floor there and its silhouette is that of the marker. Any other rotation
would leave the object floating on an edge or sunk into the floor.

With `from_above` the hand takes the object as arms do, and rises from it in the end.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import MotionSpec, hookimpl
from geoprior.geometry.interpolate import bezier, rotations_about
from geoprior.geometry.se3 import invert, make_transform
from geoprior.geometry.seeding import child
from geoprior.motions._from_above import GraspFromAbove, grasp_from_above, moved
from geoprior.motions._grasp import GraspOptions, grasp_position, reach
from geoprior.motions.course import SPEED, Leg, closed, moving, paced, run, waiting
from geoprior.motions.timing import PhaseOptions, approach_steps, eased, ramp_after
from geoprior.motions.trajectory import Trajectory, way_of_hand
from geoprior.scene.marker import draw_goal, draw_marker
from geoprior.scene.objects import WORLD_UP
from geoprior.scene.ranges import DistanceRange, LengthRange, uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]


class PlaceFromAbove(GraspFromAbove):
    """A place whose grasp is from above."""

    retreat: DistanceRange = Field(
        (0.05, 0.09), description="In the end the open hand rises by this, metres."
    )


class PlaceConfig(GraspOptions, PhaseOptions):
    """Options of `place`."""

    later = GraspOptions.later | {"from_above"}

    lift: LengthRange = Field(
        (0.08, 0.2), description="Height of the Bézier curve's inner control points over its ends, metres."
    )
    yaw: float = Field(
        90.0, ge=0.0, le=180.0, description="R_rand turns by up to this about world z, degrees."
    )
    closed: int = Field(1, ge=1, description="Steps at the grasp pose with the gripper closed.")
    opened: int = Field(1, ge=1, description="Last steps, at the goal, with the gripper open again.")
    from_above: PlaceFromAbove | None = Field(
        None, description="Grasps from above, between the fingers; null: the paper's, outside the object."
    )


@dataclass(frozen=True)
class Place:
    """See `geoprior.hooks.types.Motion`."""

    config: PlaceConfig

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan approach, transport and release.

        Raises:
            ConfigError: ``steps`` are too few, or there is no room for the marker.
        """
        config, own = self.config, child(rng, "from-above")
        if config.from_above is not None and own.random() < config.from_above.share:
            return self._from_above(config.from_above, scene, steps, own)
        ease, held, still = config.draw_ease(rng), config.closed - 1, config.opened - 1
        approach = approach_steps("place", steps, config.approach, held + still + 1)
        yaw, goal = self._draw_goal(scene, rng)
        way = reach(scene, grasp_position(scene, config, rng), approach, ease)
        carry = carried_at(
            way[-1],
            scene.object.centre,
            goal[:3, 3],
            yaw,
            uniform(rng, config.lift),
            eased(ramp_after(steps - approach - held - still), ease),
        )
        grasped = np.concatenate(
            [np.repeat(way[-1:], held, axis=0), carry, np.repeat(carry[-1:], still, axis=0)]
        )
        object_in_hand = invert(way[-1]) @ scene.object.transform_object_to_world
        at_rest = np.repeat(scene.object.transform_object_to_world[None], approach, axis=0)
        gripper = np.zeros(steps)
        gripper[approach - 1 : steps - config.opened] = 1.0
        marker = draw_marker(scene, goal, rng, walls=True)
        return Trajectory(
            hands=way_of_hand(np.concatenate([way, grasped]), gripper),
            transforms_object_to_world=np.concatenate([at_rest, grasped @ object_in_hand]),
            marker_points=marker.points,
            marker_surface=marker.surface,
            phases=("approach",) * (approach - 1)
            + ("grasp",) * config.closed
            + ("transport",) * (steps - approach - held - config.opened)
            + ("release",) * config.opened,
        )

    def _draw_goal(self, scene: Scene, rng: np.random.Generator) -> tuple[float, FloatArray]:
        """R_rand's yaw in radians, and the goal."""
        yaw = float(np.radians(rng.uniform(-self.config.yaw, self.config.yaw)))
        return yaw, draw_goal(scene, rotations_about(WORLD_UP, np.array([yaw]))[0], rng)

    def _from_above(
        self, options: PlaceFromAbove, scene: Scene, steps: int, rng: np.random.Generator
    ) -> Trajectory:
        yaw, goal = self._draw_goal(scene, rng)
        grasp = grasp_from_above(scene, options, self.config.slenderness, rng)
        start = scene.object.transform_object_to_world
        lift = uniform(rng, self.config.lift)
        carry = partial(carried_at, grasp.pose, scene.object.centre, goal[:3, 3], yaw, lift)
        placed = carry(np.ones(1))[0]
        risen = moved(placed, uniform(rng, options.retreat) * WORLD_UP)
        line = np.linalg.norm(np.diff(carry(np.linspace(0.0, 1.0, 20))[:, :3, 3], axis=0), axis=1).sum()
        legs = [
            *grasp.legs,
            closed(Leg("transport", carry, float(line) / (0.8 * SPEED)), carries=True),
            closed(waiting("transport", placed, rng.uniform(0.2, 0.5)), carries=True),
            replace(waiting("release", placed, rng.uniform(0.5, 0.8)), fingers=(0.0, 1.0)),
            moving("retreat", placed, risen),
        ]
        ran = run("place", paced(legs, options.pace, rng), steps, self.config.draw_ease(rng))
        hands = ran.transforms_hand_to_world.copy()
        hands[ran.leg > len(legs) - 3] = placed
        carried = hands @ invert(grasp.pose) @ start
        marker = draw_marker(scene, goal, rng, walls=True)
        return Trajectory(
            hands=way_of_hand(ran.transforms_hand_to_world, ran.gripper, ran.openness, grasp.grip),
            transforms_object_to_world=np.where((ran.leg < len(grasp.legs))[:, None, None], start, carried),
            marker_points=marker.points,
            marker_surface=marker.surface,
            phases=ran.phases,
        )


def transport(
    grasp: FloatArray, centre: FloatArray, goal: FloatArray, yaw: float, lift: float, steps: int
) -> FloatArray:
    """Carry the object from where it was grasped to its goal, at even steps; see `carried_at`.

    Args:
        grasp: (4, 4) T_pick.
        centre: (3,) c_obj at the grasp, metres.
        goal: (3,) c_mark, lifted to the centre of the resting object, metres.
        yaw: Of R_rand, radians.
        lift: Height of the inner control points over the ends, metres.
        steps: How many poses; T_pick itself is not among them, T_place is the last.

    Returns:
        (steps, 4, 4) hand to world.
    """
    return carried_at(grasp, centre, goal, yaw, lift, ramp_after(steps))


def carried_at(
    grasp: FloatArray, centre: FloatArray, goal: FloatArray, yaw: float, lift: float, times: FloatArray
) -> FloatArray:
    """Hand poses (N, 4, 4) to world on the way to the goal, at times (N,) from 0, T_pick, to 1, T_place.

    With the paper's delta_p = p_pick - c_obj, p_place = c_mark + R_rand delta_p and R_place = R_rand R_pick.
    The position follows a cubic Bézier curve that leaves and arrives vertically. The orientation follows
    SLERP from R_pick to R_place, which for an R_rand about world z is a steady turn about world z. For the
    other arguments see `transport`.
    """
    delta = grasp[:3, 3] - centre
    placed = goal + rotations_about(WORLD_UP, np.array([yaw]))[0] @ delta
    up = lift * WORLD_UP
    positions = bezier(np.stack([grasp[:3, 3], grasp[:3, 3] + up, placed + up, placed]), times)
    return make_transform(rotations_about(WORLD_UP, yaw * times) @ grasp[:3, :3], positions)


@hookimpl
def geoprior_motions() -> Iterable[MotionSpec]:
    """One motion."""
    yield MotionSpec(
        name="place",
        summary="grasp the object, carry it to the marker in an arc, let go",
        config=PlaceConfig,
        factory=Place,
    )
