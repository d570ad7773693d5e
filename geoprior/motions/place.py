"""Place: grasp the object as `pick` does, carry it in an arc to the marker, and let go.

The paper draws the marker by "randomly rotating the object" and wants the placed object to cover it seen
from above. Here R_rand turns about world z: the object then rests on the same face at the goal as at the
start, so that it stands on the floor there and its silhouette is that of the marker. Any other rotation
would leave the object floating on an edge or sunk into the floor.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import MotionSpec, hookimpl
from geoprior.geometry.interpolate import bezier, rotations_about
from geoprior.geometry.se3 import invert, make_transform
from geoprior.motions._grasp import GraspOptions, grasp_position, reach
from geoprior.motions.timing import PhaseOptions, approach_steps, ramp_after
from geoprior.motions.trajectory import Trajectory, way_of_hand
from geoprior.scene.marker import draw_goal, marker_points
from geoprior.scene.objects import WORLD_UP
from geoprior.scene.ranges import LengthRange, uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]


class PlaceConfig(GraspOptions, PhaseOptions):
    """Options of `place`."""

    lift: LengthRange = Field(
        (0.08, 0.2), description="Height of the Bézier curve's inner control points over its ends, metres."
    )
    yaw: float = Field(
        90.0, ge=0.0, le=180.0, description="R_rand turns by up to this about world z, degrees."
    )
    closed: int = Field(1, ge=1, description="Steps at the grasp pose with the gripper closed.")
    opened: int = Field(1, ge=1, description="Last steps, at the goal, with the gripper open again.")


@dataclass(frozen=True)
class Place:
    """See `geoprior.hooks.types.Motion`."""

    config: PlaceConfig

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan approach, transport and release.

        Raises:
            ConfigError: ``steps`` are too few, or there is no room for the marker.
        """
        config = self.config
        held, still = config.closed - 1, config.opened - 1
        moving = approach_steps("place", steps, config.approach, held + still + 1)
        yaw = float(np.radians(rng.uniform(-config.yaw, config.yaw)))
        goal = draw_goal(scene, rotations_about(WORLD_UP, np.array([yaw]))[0], rng)
        way = reach(scene, grasp_position(scene, config, rng), moving)
        carry = transport(
            way[-1],
            scene.object.centre,
            goal[:3, 3],
            yaw,
            uniform(rng, config.lift),
            steps - moving - held - still,
        )
        grasped = np.concatenate(
            [np.repeat(way[-1:], held, axis=0), carry, np.repeat(carry[-1:], still, axis=0)]
        )
        object_in_hand = invert(way[-1]) @ scene.object.transform_object_to_world
        at_rest = np.repeat(scene.object.transform_object_to_world[None], moving, axis=0)
        gripper = np.zeros(steps)
        gripper[moving - 1 : steps - config.opened] = 1.0
        return Trajectory(
            hands=way_of_hand(np.concatenate([way, grasped]), gripper),
            transforms_object_to_world=np.concatenate([at_rest, grasped @ object_in_hand]),
            marker_points=marker_points(scene, goal, rng),
            phases=("approach",) * (moving - 1)
            + ("grasp",) * config.closed
            + ("transport",) * (steps - moving - held - config.opened)
            + ("release",) * config.opened,
        )


def transport(
    grasp: FloatArray, centre: FloatArray, goal: FloatArray, yaw: float, lift: float, steps: int
) -> FloatArray:
    """Carry the object from where it was grasped to its goal.

    With the paper's delta_p = p_pick - c_obj, p_place = c_mark + R_rand delta_p and R_place = R_rand R_pick.
    The position follows a cubic Bézier curve that leaves and arrives vertically. The orientation follows
    SLERP from R_pick to R_place, which for an R_rand about world z is a steady turn about world z.

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
    times = ramp_after(steps)
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
