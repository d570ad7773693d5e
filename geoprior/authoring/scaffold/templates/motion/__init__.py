"""My-plugin: the hand comes down on the object from above and stays there, as a motion of geoprior's."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import MotionSpec, hookimpl
from geoprior.errors import ConfigError
from geoprior.geometry.interpolate import lerp, swing_frames
from geoprior.geometry.se3 import make_transform
from geoprior.motions.trajectory import Trajectory, way_of_hand
from geoprior.options import Options
from geoprior.scene.mesh import extents
from geoprior.scene.ranges import LengthRange, uniform

if TYPE_CHECKING:
    from geoprior.scene.scene import Scene

DOWN = np.array([0.0, 0.0, -1.0])
FEWEST_STEPS = 3


class MyPluginConfig(Options):
    """Options of the motion."""

    gap: LengthRange = Field((0.002, 0.01), description="Above the object's top at the end, metres.")
    approach: float = Field(0.8, gt=0.0, lt=1.0, description="Share of the steps until the hand is there.")


@dataclass(frozen=True)
class MyPlugin:
    """See `geoprior.hooks.types.Motion`. The object stays where it is; the gripper stays open."""

    config: MyPluginConfig

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan the way of the hand; every draw comes from ``rng``.

        Raises:
            ConfigError: ``steps`` are too few.
        """
        if steps < FEWEST_STEPS:
            raise ConfigError(
                f"motion 'my-plugin': {steps} steps are too few, it needs {FEWEST_STEPS}",
                "raise generate.fps or generate.seconds",
            )
        moving = min(max(2, round(self.config.approach * steps)), steps - 1)
        start, thing = scene.hand.transform_hand_to_world, scene.object
        above = 0.5 * extents(thing.mesh)[2] + uniform(rng, self.config.gap)
        times = np.minimum(np.arange(steps) / (moving - 1), 1.0)
        way = make_transform(
            swing_frames(start[:3, :3], DOWN, times),
            lerp(start[:3, 3], thing.centre - above * DOWN, times),
        )
        return Trajectory(
            hands=way_of_hand(way, np.zeros(steps)),
            transforms_object_to_world=np.repeat(thing.transform_object_to_world[None], steps, axis=0),
            marker_points=None,
            phases=("approach",) * moving + ("stay",) * (steps - moving),
        )


@hookimpl
def geoprior_motions() -> Iterable[MotionSpec]:
    """What this package adds."""
    yield MotionSpec(
        name="my-plugin",
        summary="come down on the object from above and stay there",
        config=MyPluginConfig,
        factory=MyPlugin,
    )
