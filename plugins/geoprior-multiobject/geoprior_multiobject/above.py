"""Taking hold from above, past whatever else stands around."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior.geometry.interpolate import lerp, swing_frames
from geoprior.geometry.se3 import make_transform
from geoprior.options import Options
from geoprior.scene.mesh import extents
from geoprior.scene.objects import WORLD_UP
from geoprior.scene.ranges import LengthRange, uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]


class AboveOptions(Options):
    """How the hand comes to the object: over everything, then straight down."""

    offset: LengthRange = Field(
        (0.005, 0.02), description="The grasp point lies this far above the object's top, metres."
    )
    clearance: float = Field(
        0.03, gt=0.0, le=1.0, description="The hand travels at least this far above all objects, metres."
    )


def grasp_above(scene: Scene, options: AboveOptions, rng: np.random.Generator) -> FloatArray:
    """(3,) world: above the middle of the object's top."""
    height = 0.5 * extents(scene.object.mesh)[2] + uniform(rng, options.offset)
    return np.asarray(scene.object.centre + height * WORLD_UP)


def over_and_down(scene: Scene, position: FloatArray, clearance: float, over: int, down: int) -> FloatArray:
    """The way to a grasp point above the object.

    Args:
        scene: Where the hand starts, and what it passes over.
        position: (3,) the grasp point, world, metres.
        clearance: See `AboveOptions`.
        over: Steps from the start to straight above the grasp point, the hand turning to point down.
        down: Steps from there to the grasp point.

    Returns:
        (over + down, 4, 4) hand to world; the first is the start.
    """
    start, down_axis = scene.hand.transform_hand_to_world, -WORLD_UP
    tops = [each.vertices[:, 2].max() + clearance for each in scene.objects.values()]
    above = np.array([position[0], position[1], max(position[2], *tops)])
    times = np.linspace(0.0, 1.0, over)
    turned = swing_frames(start[:3, :3], down_axis, times)
    travel = make_transform(turned, lerp(start[:3, 3], above, times))
    drop = lerp(above, position, np.linspace(0.0, 1.0, down + 1)[1:])
    return np.concatenate([travel, make_transform(np.repeat(turned[-1:], down, axis=0), drop)])
