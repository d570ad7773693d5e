"""What a motion plans: hands and objects over time, and the marker if there is one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.se3 import pose_vectors
from geoprior.scene.hand import HAND
from geoprior.scene.objects import OBJECT

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.mesh import Mesh
    from geoprior.scene.scene import Scene

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class HandWay:
    """One hand over N time steps.

    Attributes:
        transforms_hand_to_world: (N, 4, 4); hand axes [right, up, forward].
        gripper: (N,) float64, 0 open or 1 closed.
        openness: (N,) how far the fingers are apart, from 0, closed, to 1, open; None: as the gripper says.
        grip: Between the closed fingers, where they hold something, metres.
    """

    transforms_hand_to_world: FloatArray
    gripper: FloatArray
    openness: FloatArray | None = None
    grip: float = 0.0

    def fingers_apart(self) -> FloatArray:
        """(N,) `openness`, or what the gripper says."""
        return 1.0 - self.gripper if self.openness is None else self.openness


@dataclass(frozen=True)
class Trajectory:
    """N time steps of the hands and of the objects.

    Attributes:
        hands: Each hand's way, by the hand's name, in pose order: those of the motion's spec.
        transforms_object_to_world: (N, 4, 4) of the scene's `object`.
        marker_points: (M, 3) world points of the goal drawn on the floor, or None.
        phases: Name of the phase of each step, for example ``approach`` or ``transport``.
        others: (N, 4, 4) object to world of further objects that move, by name; those not named rest.
        marker_surface: The marker for renderers of solids, in the world; None for the hull of its points.
    """

    hands: Mapping[str, HandWay]
    transforms_object_to_world: FloatArray
    marker_points: FloatArray | None
    phases: tuple[str, ...]
    others: Mapping[str, FloatArray] = field(default_factory=dict)
    marker_surface: Mesh | None = None

    @property
    def steps(self) -> int:
        """N."""
        return len(next(iter(self.hands.values())).gripper)

    @property
    def hand(self) -> HandWay:
        """The way of the hand named ``hand``: the only one, unless the motion's spec names others."""
        return self.hands[HAND]

    def pose(self) -> NDArray[np.float32]:
        """(N, 8 x hands) pose vectors; see `geoprior.geometry.se3.pose_vectors`."""
        poses = [pose_vectors(way.transforms_hand_to_world, way.gripper) for way in self.hands.values()]
        return np.concatenate(poses, axis=1)


def ways_of_objects(scene: Scene, trajectory: Trajectory) -> dict[str, FloatArray]:
    """Where every object of a scene is, by name: (N, 4, 4) object to world, or (4, 4) of one that rests."""
    resting = {name: other.transform_object_to_world for name, other in scene.others.items()}
    return {OBJECT: trajectory.transforms_object_to_world, **resting, **trajectory.others}


def way_of_hand(
    transforms_hand_to_world: FloatArray,
    gripper: FloatArray,
    openness: FloatArray | None = None,
    grip: float = 0.0,
) -> dict[str, HandWay]:
    """The `Trajectory.hands` of a motion that moves the hand named ``hand``; see `HandWay`."""
    return {HAND: HandWay(transforms_hand_to_world, gripper, openness, grip)}
