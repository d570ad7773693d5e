"""Stack: the hand takes the object from above, carries it in an arc onto another one, and lets go."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import MotionSpec, hookimpl
from geoprior.geometry.se3 import invert
from geoprior.motions.place import transport
from geoprior.motions.timing import shared_out
from geoprior.motions.trajectory import Trajectory, way_of_hand
from geoprior.options import Choice
from geoprior.scene.config import OtherConfig
from geoprior.scene.mesh import extents
from geoprior.scene.objects import WORLD_UP
from geoprior.scene.ranges import LengthRange, uniform
from geoprior_multiobject.above import AboveOptions, grasp_above, over_and_down

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.scene import Scene

BASE = "base"
_FLAT = ("prism", "cylinder", "truncated-pyramid", "truncated-cone")
"""Primitives that something can stand on."""


class StackConfig(AboveOptions):
    """Options of `stack`."""

    base: OtherConfig = Field(
        default=OtherConfig(primitives=[Choice(name=name) for name in _FLAT], distance=(0.12, 0.3), gap=0.06),
        description="What the object is put on, with a flat top, and where that rests.",
    )
    lift: LengthRange = Field(
        (0.06, 0.15),
        description="Height of the Bézier curve's inner control points over its ends, on top of the base's, "
        "metres.",
    )
    yaw: float = Field(
        90.0, ge=0.0, le=180.0, description="The object is turned by up to this on its way, degrees."
    )
    over: float = Field(
        0.3, gt=0.0, lt=1.0, description="Share of the steps until the hand is above the object."
    )
    down: float = Field(0.2, gt=0.0, lt=1.0, description="Share of the steps from there to the grasp.")


@dataclass(frozen=True)
class Stack:
    """See `geoprior.hooks.types.Motion`. The base stays where it is."""

    config: StackConfig

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan approach, transport and release.

        Raises:
            ConfigError: ``steps`` are too few.
        """
        config, rest = self.config, scene.object.transform_object_to_world
        shares = [config.over, config.down, max(1.0 - config.over - config.down, 0.0)]
        over, down, carried = shared_out("stack", steps, shares)
        way = over_and_down(scene, grasp_above(scene, config, rng), config.clearance, over, down)
        yaw = float(np.radians(rng.uniform(-config.yaw, config.yaw)))
        lift = uniform(rng, config.lift) + extents(scene.others[BASE].mesh)[2]
        carry = transport(way[-1], scene.object.centre, resting_place(scene), yaw, lift, carried)
        gripper = np.zeros(steps)
        gripper[over + down - 1 : -1] = 1.0
        object_in_hand = invert(way[-1]) @ rest
        return Trajectory(
            hands=way_of_hand(np.concatenate([way, carry]), gripper),
            transforms_object_to_world=np.concatenate(
                [np.repeat(rest[None], over + down, axis=0), carry @ object_in_hand]
            ),
            marker_points=None,
            phases=("approach",) * over
            + ("descent",) * (down - 1)
            + ("grasp",)
            + ("transport",) * (carried - 1)
            + ("release",),
        )


def resting_place(scene: Scene) -> NDArray[np.float64]:
    """(3,) the centre of the object when it stands on the middle of the base, world, metres."""
    base = scene.others[BASE]
    height = 0.5 * (extents(base.mesh)[2] + extents(scene.object.mesh)[2])
    return np.asarray(base.centre + height * WORLD_UP)


@hookimpl
def geoprior_motions() -> Iterable[MotionSpec]:
    """One motion."""
    yield MotionSpec(
        name="stack",
        summary="take the object from above, carry it in an arc onto another, let go",
        config=StackConfig,
        factory=Stack,
        others=lambda config: {BASE: config.base},
    )
