"""Pushes as arms do them: over the point behind the object, down, straight to the marker, and stay.

The hand points down, and what pushes is the side of its fingers, or of its cube where it has none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior.geometry.se3 import make_transform
from geoprior.motions._from_above import heading_of, moved, nearest_angle, opening
from geoprior.motions.course import CourseOptions, Leg, closed, moving, waiting
from geoprior.scene.hand import hand_rotation
from geoprior.scene.mesh import extents
from geoprior.scene.objects import WORLD_UP
from geoprior.scene.ranges import DistanceRange, LengthRange, uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]

_OVER = 0.02
"""Metres between the object's top and the lowest point of a hand that goes to behind it."""
_BESIDE = 0.001
"""Metres above the object's top: what of the hand is higher than this does not push."""


class PushFromAbove(CourseOptions):
    """A push whose hand comes down behind the object."""

    closed: bool = Field(
        default=True, description="Whether the gripper closes at the start and stays closed."
    )
    across: float = Field(
        0.5,
        ge=0.0,
        le=1.0,
        description="Share of the pushes whose hand has its up axis across the push; of the others it points "
        "ahead.",
    )
    tilt: float = Field(
        0.0,
        ge=0.0,
        le=45.0,
        description="The hand leans from straight down towards the push by up to this, degrees.",
    )
    height: LengthRange = Field(
        (0.005, 0.014), description="Of the hand's lowest point above the floor while it pushes, metres."
    )
    behind: DistanceRange = Field(
        (0.006, 0.02), description="The hand comes down this far behind where it will touch, metres."
    )
    above: LengthRange = Field(
        (0.06, 0.09),
        description="The hand goes to a point this far above where it comes down first, metres; farther if "
        "the object is tall.",
    )


@dataclass(frozen=True)
class Stroke:
    """A push that has been decided on.

    Attributes:
        legs: From the start to the end.
        pushing: Number of the leg that pushes.
        touch: (3,) where the hand's origin is when it touches the object, metres.
    """

    legs: tuple[Leg, ...]
    pushing: int
    touch: FloatArray


def push_from_above(
    scene: Scene,
    goal: FloatArray,
    direction: FloatArray,
    options: PushFromAbove,
    gap: float,
    rng: np.random.Generator,
) -> Stroke:
    """Decide how to push the object to its goal.

    A vertical plane across the push parts the hand from the object at all times: the hand stays behind it by
    ``gap`` or more, as far as the hand reaches ahead below the object's top.

    Args:
        scene: The scene.
        goal: (4, 4) object to world in the end.
        direction: (3,) horizontal unit vector of the push.
        options: Ranges.
        gap: Between hand and object while it pushes, metres.
        rng: Draws.
    """
    rotation = _pushing_frame(scene, direction, options, rng)
    centre, wide = scene.object.centre, 0.0 if options.closed else opening(scene)
    solids = [each.vertices @ rotation.T for each in scene.hand.solids(wide)]
    lowest = min(float(each[:, 2].min()) for each in solids)
    height = scene.floor.height + uniform(rng, options.height) - min(lowest, 0.0)
    top = centre[2] + 0.5 * float(extents(scene.object.mesh)[2])
    low = [each for each in solids if each[:, 2].min() + height < top + _BESIDE]
    ahead = max(float((each @ direction).max()) for each in low) if low else 0.0
    back = float(np.max((scene.object.vertices - centre) @ -direction)) + gap + ahead
    touch = np.array([*(centre - back * direction)[:2], height])
    at_touch = make_transform(rotation, touch)
    behind = moved(at_touch, -uniform(rng, options.behind) * direction)
    over = max(height + uniform(rng, options.above), top + _OVER - min(lowest, 0.0))
    above = moved(behind, (over - height) * WORLD_UP)
    end = moved(at_touch, goal[:3, 3] - centre)
    legs: tuple[Leg, ...] = (
        moving("approach", scene.hand.transform_hand_to_world, above),
        waiting("approach", above, rng.uniform(0.1, 0.3)),
        moving("approach", above, behind, rng.uniform(0.5, 0.7)),
        waiting("approach", behind, rng.uniform(0.1, 0.4)),
        moving("push", behind, end, rng.uniform(0.4, 0.6)),
        waiting("push", end, rng.uniform(0.5, 1.0)),
    )
    if options.closed:
        legs = (replace(legs[0], gripper=1.0, fingers=(1.0, 0.0)), *(closed(leg) for leg in legs[1:]))
    return Stroke(legs, len(legs) - 2, touch)


def _pushing_frame(
    scene: Scene, direction: FloatArray, options: PushFromAbove, rng: np.random.Generator
) -> FloatArray:
    """The hand frame (3, 3): up ahead or across, whichever way is nearer, and leaning towards the push."""
    heading = float(np.arctan2(direction[1], direction[0]))
    if rng.random() < options.across:
        sides = heading + np.array([0.5, -0.5]) * np.pi
        heading = nearest_angle(sides, heading_of(scene.hand.transform_hand_to_world[:3, :3]))
    lean = np.radians(rng.uniform(0.0, options.tilt))
    return hand_rotation(np.sin(lean) * direction - np.cos(lean) * WORLD_UP, heading)
