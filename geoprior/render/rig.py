"""The two cameras of a synthetic episode and what each of them sees.

``hand`` rides on the hand and sees floor, object and marker, never the hand. ``third`` is fixed and sees
floor, object, marker and the hand's cube.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.projection import View
from geoprior.geometry.se3 import invert
from geoprior.render.clouds import Cloud, Shot
from geoprior.render.packing import unpack_frames

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.hooks.types import Renderer
    from geoprior.motions.trajectory import Trajectory
    from geoprior.scene.scene import Scene

HAND = "hand"
THIRD = "third"


def shots(scene: Scene, trajectory: Trajectory) -> dict[str, Shot]:
    """The shot of each camera, by name in alphabetical order."""
    world = np.eye(4)
    seen = [
        Cloud("floor", scene.floor.points, world),
        Cloud("object", scene.object.points, trajectory.transforms_object_to_world),
    ]
    if trajectory.marker_points is not None:
        seen.append(Cloud("marker", trajectory.marker_points, world))
    cube = Cloud("hand", scene.hand.points, trajectory.transforms_hand_to_world)
    lens = scene.hand_view
    cameras = trajectory.transforms_hand_to_world @ scene.hand.transform_camera_to_hand
    riding = View(invert(cameras), lens.intrinsics, lens.height, lens.width)
    steps = len(trajectory.gripper)
    return {
        HAND: Shot(riding, tuple(seen), steps),
        THIRD: Shot(scene.third_view, (*seen, cube), steps),
    }


def render(renderer: Renderer, shot: Shot) -> NDArray[np.uint8]:
    """Frames (N, H, W) of one camera, 0 or 255."""
    return unpack_frames(renderer.render(shot.clouds, shot.view, shot.steps), shot.view.width)
