"""Grasps from above, as arms take hold of what lies on a table: over the object, down, close.

The hand points down and the object lies between its fingers; the paper's grasps stop outside the object.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior.geometry.interpolate import swing_frames
from geoprior.geometry.se3 import apply, invert, make_transform
from geoprior.motions.course import CLOSING, CourseOptions, Leg, moving, waiting
from geoprior.scene.hand import hand_rotation
from geoprior.scene.mesh import extents
from geoprior.scene.objects import WORLD_UP
from geoprior.scene.ranges import DistanceRange, LengthRange, SecondsRange, uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.mesh import Mesh
    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]

FLOOR_CLEARANCE = 0.002
"""Metres between the floor and the lowest point of a hand."""
_FINGER_CLEARANCE = 0.002
"""Metres between an open finger and what it goes down beside."""


class GraspFromAbove(CourseOptions):
    """A grasp from above; needs no more of `GraspOptions` than `slenderness`."""

    depth: DistanceRange = Field(
        (0.01, 0.03),
        description="The hand's origin ends this far below the object's top, between the fingers, metres; "
        "less where the floor is in the way or the fingers do not open that wide.",
    )
    tilt: float = Field(
        0.0, ge=0.0, le=45.0, description="The hand leans from straight down by up to this, degrees."
    )
    above: LengthRange = Field(
        (0.08, 0.12), description="The hand goes to a point this far above the grasp first, metres."
    )
    closing: SecondsRange = Field(
        (CLOSING, CLOSING),
        description="Nominal seconds for which the hand waits for its fingers; they stretch with the "
        "episode's length.",
    )


@dataclass(frozen=True)
class Grasp:
    """A grasp from above that has been decided on.

    Attributes:
        above: (4, 4) hand to world: where the hand goes first.
        pose: (4, 4) where it closes.
        grip: Between the closed fingers, metres.
        legs: From the start to the closed fingers.
    """

    above: FloatArray
    pose: FloatArray
    grip: float
    legs: tuple[Leg, ...]


def grasp_from_above(
    scene: Scene, options: GraspFromAbove, slenderness: float, rng: np.random.Generator
) -> Grasp:
    """Decide how to take the object from above.

    The fingers close along the shorter horizontal side of the object's bounding box, or along either where
    the longer one is at most ``slenderness`` times as long; of the equivalent yaws the nearest to the hand's
    is taken, as the scripted demonstrations do.
    """
    rotation = _leaning(_nearest_heading(scene, slenderness), options.tilt, rng)
    position = scene.object.centre.copy()
    top = position[2] + 0.5 * float(extents(scene.object.mesh)[2])
    hang = -float((rotation[2] @ hand_corners(scene, opening(scene)).T).min())
    position[2] = max(top - uniform(rng, options.depth), scene.floor.height + FLOOR_CLEARANCE + hang)
    width = width_between(scene, make_transform(rotation, position))
    fingers = scene.hand.fingers
    if fingers is not None and width > fingers.opening - 2.0 * _FINGER_CLEARANCE:
        position[2], width = top + hang + _FINGER_CLEARANCE, 0.0
    pose = make_transform(rotation, position)
    above = moved(pose, -uniform(rng, options.above) * rotation[:, 2])
    close = waiting("grasp", pose, uniform(rng, options.closing))
    legs = (
        moving("approach", scene.hand.transform_hand_to_world, above),
        moving("approach", above, pose, rng.uniform(0.5, 0.7)),
        waiting("approach", pose, rng.uniform(0.1, 0.2)),
        replace(close, gripper=1.0, fingers=(1.0, 0.0)),
    )
    return Grasp(above, pose, width, legs)


def moved(pose: FloatArray, shift: FloatArray) -> FloatArray:
    """The pose (4, 4) shifted by (3,) metres in the world."""
    return make_transform(pose[:3, :3], pose[:3, 3] + shift)


def opening(scene: Scene) -> float:
    """Between the open fingers of the scene's hand, metres; 0 of a hand without fingers."""
    return scene.hand.fingers.opening if scene.hand.fingers else 0.0


def hand_corners(scene: Scene, gap: float) -> FloatArray:
    """(C, 3) corners of the hand's boxes, and its origin, in the hand frame."""
    return np.vstack([np.zeros((1, 3)), *(each.vertices for each in scene.hand.solids(gap))])


def width_between(scene: Scene, pose: FloatArray) -> float:
    """How far the fingers stay apart that close on the object at a pose (4, 4), metres.

    They are taken to be as wide as the object, which is convex: no part of it above the plane of the finger
    tips is then inside a finger. 0 of a hand without fingers.
    """
    fingers = scene.hand.fingers
    if fingers is None:
        return 0.0
    to_hand = invert(pose) @ scene.object.transform_object_to_world
    across = _above_plane(scene.object.mesh, apply(to_hand, scene.object.mesh.vertices), fingers.past)
    return 2.0 * float(np.abs(across[:, 0]).max(initial=0.0))


def _above_plane(mesh: Mesh, vertices: FloatArray, tip: float) -> FloatArray:
    """Corners (K, 3) of the part of a convex mesh that lies behind ``tip`` of the hand's forward axis."""
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    first, second = vertices[edges[:, 0]], vertices[edges[:, 1]]
    crossing = (first[:, 2] < tip) & (second[:, 2] > tip)
    first, second = first[crossing], second[crossing]
    share = (tip - first[:, 2]) / (second[:, 2] - first[:, 2])
    return np.concatenate([vertices[vertices[:, 2] <= tip], first + share[:, None] * (second - first)])


def heading_of(rotation: FloatArray) -> float:
    """Radians: the heading of a hand frame (3, 3), as `geoprior.scene.hand.hand_rotation` takes it."""
    up = swing_frames(rotation, -WORLD_UP, np.ones(1))[0][:, 1]
    return float(np.arctan2(up[1], up[0]))


def nearest_angle(angles: FloatArray, to: float) -> float:
    """Of some angles (K,) the nearest to another one; radians."""
    turns = (angles - to + np.pi) % (2.0 * np.pi) - np.pi
    return float(to + turns[np.argmin(np.abs(turns))])


def _nearest_heading(scene: Scene, slenderness: float) -> float:
    """The up axis' heading whose fingers close along a slender side: right is a quarter turn ahead of up."""
    sizes = extents(scene.object.mesh)[:2]
    along = scene.object.yaw + np.array([0.5 * np.pi, 0.0])
    slender = along[sizes <= slenderness * sizes[::-1]]
    angles = np.concatenate([slender, slender + np.pi])
    return nearest_angle(angles, heading_of(scene.hand.transform_hand_to_world[:3, :3]))


def _leaning(heading: float, tilt: float, rng: np.random.Generator) -> FloatArray:
    """The hand frame (3, 3) at a heading, leaning in a random direction."""
    lean, azimuth = np.radians(tilt) * np.sqrt(rng.random()), rng.uniform(-np.pi, np.pi)
    across = np.sin(lean)
    forward = np.array([across * np.cos(azimuth), across * np.sin(azimuth), -np.cos(lean)])
    return hand_rotation(forward, heading)
