"""Random walk: the hand wanders from waypoint to waypoint and has nothing to do with the object.

Of its ablation "random motion data" the paper says that the hand moves at random, no more. Here the hand goes
as fast and turns as fast as in pick, place and push taken together, in the space where they take place: what
is missing is what the motion is for, not its scale. The hand may pass through the object.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import MotionSpec, hookimpl
from geoprior.errors import ConfigError
from geoprior.geometry.se3 import make_transform
from geoprior.motions.trajectory import Trajectory, way_of_hand
from geoprior.options import Options
from geoprior.scene.hand import hand_rotation
from geoprior.scene.ranges import LengthRange, uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]


class RandomWalkConfig(Options):
    """Options of `random-walk`."""

    legs: int = Field(4, ge=1, le=100, description="Ways between waypoints, each as many steps.")
    leg: LengthRange = Field(
        (0.03, 0.2), description="From a waypoint to the next, metres; less if that is nearer."
    )
    turn: float = Field(
        60.0,
        ge=0.0,
        le=180.0,
        description="The hand turns by up to this from a waypoint to the next, degrees.",
    )
    reach: float = Field(
        0.25, ge=0.0, le=5.0, description="Waypoints lie within this of the origin in x and in y, metres."
    )
    height: LengthRange = Field(
        (0.01, 0.15), description="Of the hand's lowest point above the floor, at a waypoint, metres."
    )
    tilt: float = Field(
        90.0, ge=0.0, le=180.0, description="Waypoints turn forward to within this of straight down, degrees."
    )
    heading_spread: float = Field(
        60.0, ge=0.0, le=180.0, description="The heading at a waypoint lies within this of +x, degrees."
    )
    toggle: float = Field(
        0.15, ge=0.0, le=1.0, description="Chance that the gripper closes or opens at a waypoint on the way."
    )


@dataclass(frozen=True)
class RandomWalk:
    """See `geoprior.hooks.types.Motion`. The object stays where it is, and there is no marker."""

    config: RandomWalkConfig

    def plan(self, scene: Scene, steps: int, rng: np.random.Generator) -> Trajectory:
        """Plan the walk. From the same start the same draws give the same walk past any object.

        Raises:
            ConfigError: ``steps`` are too few to give every leg one.
        """
        legs = self.config.legs
        if steps <= legs:
            raise ConfigError(
                f"motion 'random-walk': {steps} steps are too few for {legs} legs, it needs {legs + 1}",
                "raise generate.fps or generate.seconds, or lower the motion's legs",
            )
        leg = np.minimum(np.arange(steps) * legs // (steps - 1), legs - 1)
        return Trajectory(
            hands=way_of_hand(self._hand(scene, steps, rng), self._gripper(rng)[leg]),
            transforms_object_to_world=np.repeat(scene.object.transform_object_to_world[None], steps, axis=0),
            marker_points=None,
            phases=tuple(f"leg-{number + 1}" for number in leg),
        )

    def _hand(self, scene: Scene, steps: int, rng: np.random.Generator) -> FloatArray:
        """The hand's way (N, 4, 4). The frames come first: how deep the cube hangs decides the height."""
        start = scene.hand.transform_hand_to_world
        times = np.linspace(0.0, 1.0, steps)
        rotations = through_frames(self._frames(start[:3, :3], rng), times)
        depths = -(rotations[:, 2] @ scene.hand.points.T).min(axis=1)
        above = np.column_stack([np.zeros((steps, 2)), scene.floor.height + depths])
        places = through_points(self._places(start[:3, 3] - above[0], rng), times)
        return make_transform(rotations, places + above)

    def _frames(self, start: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Waypoints' frames (legs + 1, 3, 3), each turned towards a random one in the cone."""
        from scipy.spatial.transform import Rotation

        tilt, spread = np.radians(self.config.tilt), np.radians(self.config.heading_spread)
        frames = [start]
        for _ in range(self.config.legs):
            way = Rotation.from_matrix(frames[-1].T @ working_frame(tilt, spread, rng)).as_rotvec()
            turn = np.radians(rng.uniform(0.0, self.config.turn))
            share = _share(turn, float(np.linalg.norm(way)))
            frames.append(frames[-1] @ Rotation.from_rotvec(share * way).as_matrix())
        return np.stack(frames)

    def _places(self, start: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Waypoints (legs + 1, 3) as x, y and height of the lowest point, each on the way to a random one."""
        reach, (lowest, highest) = self.config.reach, self.config.height
        low, high = np.array([-reach, -reach, lowest]), np.array([reach, reach, highest])
        places = [start]
        for _ in range(self.config.legs):
            way = rng.uniform(low, high) - places[-1]
            share = _share(uniform(rng, self.config.leg), float(np.linalg.norm(way)))
            places.append(places[-1] + share * way)
        return np.stack(places)

    def _gripper(self, rng: np.random.Generator) -> FloatArray:
        """State on each leg (legs,), open on the first."""
        toggles = rng.random(self.config.legs) < self.config.toggle
        toggles[0] = False
        return np.cumsum(toggles) % 2.0


def working_frame(tilt: float, heading_spread: float, rng: np.random.Generator) -> FloatArray:
    """A random hand frame (3, 3) about straight down: forward uniform on a cap, heading about +x; radians."""
    down = rng.uniform(np.cos(tilt), 1.0)
    azimuth = rng.uniform(-np.pi, np.pi)
    level = np.sqrt(1.0 - down * down)
    forward = np.array([level * np.cos(azimuth), level * np.sin(azimuth), -down])
    return hand_rotation(forward, rng.uniform(-heading_spread, heading_spread))


def through_points(points: FloatArray, times: FloatArray) -> FloatArray:
    """A smooth curve (N, 3) through points (K, 3) at even times in [0, 1].

    Piecewise cubic with a continuous velocity and monotone between neighbours in each coordinate (Fritsch
    and Carlson's rule, SciPy's PCHIP): it never swings out beyond its points, and so never below the floor.
    """
    from scipy.interpolate import PchipInterpolator

    return np.asarray(PchipInterpolator(np.linspace(0.0, 1.0, len(points)), points)(times))


def through_frames(frames: FloatArray, times: FloatArray) -> FloatArray:
    """Rotations (N, 3, 3) by SLERP from each of the frames (K, 3, 3) to the next, at even times in [0, 1]."""
    from scipy.spatial.transform import Rotation, Slerp

    way = Slerp(np.linspace(0.0, 1.0, len(frames)), Rotation.from_matrix(frames))
    return np.asarray(way(times).as_matrix())


def _share(step: float, way: float) -> float:
    """How much of a way one step covers: all of it, where the step is longer."""
    return step / way if way > step else 1.0


@hookimpl
def geoprior_motions() -> Iterable[MotionSpec]:
    """One motion."""
    yield MotionSpec(
        name="random-walk",
        summary="wander between random waypoints, whatever the object (ablation)",
        config=RandomWalkConfig,
        factory=RandomWalk,
    )
