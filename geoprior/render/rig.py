"""The two cameras of a synthetic episode and what each of them sees.

``hand`` rides on the hand and sees floor, object and marker, never the hand. ``third`` is fixed and sees
floor, object, marker and the hand's cube.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.projection import View
from geoprior.geometry.se3 import invert
from geoprior.render.clouds import Cloud

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.hooks.types import Renderer
    from geoprior.motions.trajectory import Trajectory
    from geoprior.scene.scene import Scene

HAND = "hand"
THIRD = "third"


@dataclass(frozen=True)
class Shot:
    """One camera over an episode, and what is before it."""

    view: View
    clouds: tuple[Cloud, ...]


def shots(scene: Scene, trajectory: Trajectory) -> dict[str, Shot]:
    """The shot of each camera, by name in alphabetical order."""
    world = np.eye(4)
    seen = [
        Cloud(scene.floor.points, world),
        Cloud(scene.object.points, trajectory.transforms_object_to_world),
    ]
    if trajectory.marker_points is not None:
        seen.append(Cloud(trajectory.marker_points, world))
    cube = Cloud(scene.hand.points, trajectory.transforms_hand_to_world)
    lens = scene.hand_view
    cameras = trajectory.transforms_hand_to_world @ scene.hand.transform_camera_to_hand
    riding = View(invert(cameras), lens.intrinsics, lens.height, lens.width)
    return {HAND: Shot(riding, tuple(seen)), THIRD: Shot(scene.third_view, (*seen, cube))}


def render(renderer: Renderer, scene: Scene, trajectory: Trajectory) -> dict[str, NDArray[np.uint8]]:
    """Frames (N, H, W) of each camera, by name."""
    steps = len(trajectory.gripper)
    return {
        name: renderer.render(shot.clouds, shot.view, steps)
        for name, shot in shots(scene, trajectory).items()
    }
