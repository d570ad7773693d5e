"""How two hands take hold of one object from opposite sides, and what the motions make of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior.geometry.interpolate import lerp, swing_frames
from geoprior.geometry.se3 import apply, make_transform
from geoprior.motions.push import support
from geoprior.options import Options
from geoprior.scene.objects import WORLD_UP
from geoprior.scene.ranges import LengthRange, uniform
from geoprior.scene.rejection import draw_until

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.hand import Hand
    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]

STEEPEST = 85.0
"""Degrees by which a hand leans at most: even on a small object the cubes are then clear of each other."""


class GraspOptions(Options):
    """Where the hands take hold, and how the object travels."""

    gap: LengthRange = Field(
        (0.002, 0.01), description="Between the front of a hand's cube and the object, metres."
    )
    lift: LengthRange = Field(
        (0.08, 0.2), description="Height of a Bézier curve's inner control points over its ends, metres."
    )
    yaw: float = Field(
        45.0, ge=0.0, le=90.0, description="The object turns by up to this about world z on its way, degrees."
    )


def opposite_grasps(scene: Scene, options: GraspOptions, rng: np.random.Generator) -> dict[str, FloatArray]:
    """Grasp poses of two hands that point at the object's centre from two sides, leaning by one angle.

    The sides are those of the object's box along which the hands are farther apart at the start, so that each
    hand has the nearer one. Each front face parts its cube from the object, as in the core's `push`, and the
    lean, from straight down, is drawn until each cube is on its own side of the object's middle.

    Returns:
        (4, 4) hand to world, by the hand's name.
    """
    first, second = scene.hands.values()
    axes, apart = scene.object.transform_object_to_world[:3, :2], first.position - second.position
    axis = axes[:, np.argmax(np.abs(apart @ axes))]
    outward = np.sign(apart @ axis) * axis
    sides = dict(zip(scene.hands, (outward, -outward), strict=True))

    def draw() -> dict[str, FloatArray]:
        lean = np.radians(rng.uniform(0.0, STEEPEST))
        return {
            name: _grasp(scene, scene.hands[name], side, lean, uniform(rng, options.gap))
            for name, side in sides.items()
        }

    def clear(grasps: dict[str, FloatArray]) -> bool:
        cubes = {name: apply(pose, scene.hands[name].points) for name, pose in grasps.items()}
        return all(((cubes[name] - scene.object.centre) @ side).min() > 0.0 for name, side in sides.items())

    return draw_until(draw, clear, "two hands on one object", "lower scene.hand.cube")


def _grasp(scene: Scene, hand: Hand, outward: FloatArray, lean: float, gap: float) -> FloatArray:
    forward = -np.sin(lean) * outward - np.cos(lean) * WORLD_UP
    distance = support(scene.object.vertices - scene.object.centre, -forward) + gap
    rotation = swing_frames(hand.transform_hand_to_world[:3, :3], forward, np.ones(1))[0]
    return make_transform(rotation, scene.object.centre - distance * forward)


def draw_yaw(options: GraspOptions, rng: np.random.Generator) -> float:
    """By how much the object turns on its way, radians."""
    return float(np.radians(rng.uniform(-options.yaw, options.yaw)))


def straight(start: FloatArray, end: FloatArray, count: int) -> FloatArray:
    """Poses (count, 4, 4) from one (4, 4) to another: a straight line, and the least turn of forward.

    The last frame is ``end``'s if that came about by the least turn from ``start``.
    """
    times = np.linspace(0.0, 1.0, count)
    rotations = swing_frames(start[:3, :3], end[:3, 2], times)
    return make_transform(rotations, lerp(start[:3, 3], end[:3, 3], times))


def moved(pose: FloatArray, shift: FloatArray) -> FloatArray:
    """The pose (4, 4) shifted by (3,) metres in the world."""
    return make_transform(pose[:3, :3], pose[:3, 3] + shift)
