"""The paper's grasp heuristic and the way to it, shared by `pick` and `place`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior.geometry.interpolate import lerp, swing_frames
from geoprior.geometry.se3 import apply, make_transform
from geoprior.motions.timing import EaseOptions, eased, ramp
from geoprior.scene.mesh import extents
from geoprior.scene.ranges import LengthRange, uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]


class GraspOptions(EaseOptions):
    """Where the hand takes hold."""

    offset: LengthRange = Field(
        (0.005, 0.02),
        description="The grasp point lies this far outside its face of the bounding box, metres.",
    )
    slenderness: float = Field(
        1.25,
        ge=1.0,
        description="A side is slender if its area is at most so many times that of the smallest side.",
    )


def grasp_position(scene: Scene, options: GraspOptions, rng: np.random.Generator) -> FloatArray:
    """p_pick: outside the middle of a slender side of the object's bounding box, on the hand's side.

    The box is the object's own (it turns with the object's yaw). Its three pairs of opposite faces are
    ranked by area; of all faces of the slender pairs the one whose middle is nearest to the hand is taken.
    With a cube every face is slender, and a hand above it grasps from above. The face on the floor is never
    nearest, since the hand starts above the object.

    Returns:
        (3,) world, metres.
    """
    size = extents(scene.object.mesh)
    areas = np.prod(size) / size
    slender = np.flatnonzero(areas <= options.slenderness * areas.min())
    normals = np.vstack([np.eye(3)[slender], -np.eye(3)[slender]])
    middles = apply(scene.object.transform_object_to_world, 0.5 * size * normals)
    nearest = int(np.argmin(np.linalg.norm(middles - scene.hand.position, axis=1)))
    outward = scene.object.transform_object_to_world[:3, :3] @ normals[nearest]
    return np.asarray(middles[nearest] + uniform(rng, options.offset) * outward)


def reach(scene: Scene, position: FloatArray, steps: int, ease: float = 0.0) -> FloatArray:
    """The pick motion: from the start to ``position``, forward turning to the object's centre.

    Position by linear interpolation; forward by SLERP, with right and up carried along. For ``ease`` see
    `geoprior.motions.timing.eased`.

    Returns:
        (steps, 4, 4) hand to world; the first is the start and the last the grasp pose T_pick.
    """
    times = eased(ramp(steps), ease)
    start = scene.hand.transform_hand_to_world
    forward = scene.object.centre - position
    rotations = swing_frames(start[:3, :3], forward / np.linalg.norm(forward), times)
    return make_transform(rotations, lerp(start[:3, 3], position, times))
