"""Hand over: one hand brings the object to the other, which takes it to the marker."""

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
from geoprior.scene.ranges import Length, LengthRange, uniform
from geoprior_bimanual import HANDS
from geoprior_bimanual.grasps import (
    GraspOptions,
    draw_yaw,
    moved,
    opposite_grasps,
    straight,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]

PHASES = ("approach", "bring", "receive", "part", "carry")


class HandOverConfig(GraspOptions):
    """Options of `hand-over`."""

    height: LengthRange = Field(
        (0.08, 0.2), description="By which the object is lifted to where it is handed over, metres."
    )
    retreat: Length = Field(
        0.1, description="A hand that does not hold the object keeps this far back from it, metres."
    )
    shares: tuple[float, float, float, float, float] = Field(
        (0.25, 0.2, 0.15, 0.1, 0.3),
        description="How the steps are shared by: approach of the first hand; its way to the meeting place; "
        "approach of the second hand; retreat of the first; way of the second to the marker.",
    )


@dataclass(frozen=True)
class HandOver:
    """See `geoprior.hooks.types.Motion`. The hand whose grasp is nearer to its start gives."""

    config: HandOverConfig

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan the five phases.

        Raises:
            ConfigError: ``steps`` are too few, or there is no room for the marker.
        """
        config = self.config
        counts = shared_out("hand-over", steps, config.shares)
        approach, bring, receive, part, carry = counts
        start, yaw = scene.object.transform_object_to_world, draw_yaw(config, rng)
        goal = draw_goal(scene, rotations_about(WORLD_UP, np.array([yaw]))[0], rng)
        grasps = opposite_grasps(scene, config, rng)
        giver, taker = sorted(grasps, key=lambda name: _distance(scene, name, grasps[name]))
        shift = 0.5 * (goal[:3, 3] - start[:3, 3]) + uniform(rng, config.height) * WORLD_UP
        met, take = moved(start, shift), moved(grasps[taker], shift)
        brought = transport(start, start[:3, 3], met[:3, 3], 0.0, 0.0, bring)
        taken = transport(met, met[:3, 3], goal[:3, 3], yaw, uniform(rng, config.lift), carry)
        give = moved(grasps[giver], shift)
        wait, away = (moved(pose, -config.retreat * pose[:3, 2]) for pose in (take, give))
        ways = {
            giver: [
                straight(scene.hands[giver].transform_hand_to_world, grasps[giver], approach),
                brought @ (invert(start) @ grasps[giver]),
                _stay(give, receive),
                straight(give, away, part),
                _stay(away, carry),
            ],
            taker: [
                straight(scene.hands[taker].transform_hand_to_world, wait, approach + bring),
                straight(wait, take, receive),
                _stay(take, part),
                taken @ (invert(met) @ take),
            ],
        }
        handed = approach + bring + receive
        grippers = {name: np.zeros(steps) for name in ways}
        grippers[giver][approach - 1 : handed] = 1.0
        grippers[taker][handed - 1 : -1] = 1.0
        bodies = [_stay(start, approach), brought, _stay(met, receive + part), taken]
        return Trajectory(
            hands={name: HandWay(np.concatenate(ways[name]), grippers[name]) for name in scene.hands},
            transforms_object_to_world=np.concatenate(bodies),
            marker_points=marker_points(scene, goal, rng),
            phases=tuple(phase for phase, count in zip(PHASES, counts, strict=True) for _ in range(count)),
        )


def _distance(scene: Scene, name: str, grasp: FloatArray) -> float:
    return float(np.linalg.norm(grasp[:3, 3] - scene.hands[name].position))


def _stay(pose: FloatArray, count: int) -> FloatArray:
    return np.repeat(pose[None], count, axis=0)


@hookimpl
def geoprior_motions() -> Iterable[MotionSpec]:
    """One motion."""
    yield MotionSpec(
        name="hand-over",
        summary="one hand brings the object to the other, which takes it to the marker",
        config=HandOverConfig,
        factory=HandOver,
        hands=HANDS,
    )
