"""The cameras of a synthetic episode and what each of them sees.

Each hand carries a camera that bears the hand's name. It sees floor, objects, marker, distractors, the other
hands' cubes and all fingers, never its own hand's cube. ``third`` is fixed and sees those, every hand's cube
and the arms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.projection import View
from geoprior.geometry.se3 import invert, make_transform
from geoprior.motions.trajectory import ways_of_objects
from geoprior.render.clouds import Cloud, Shot
from geoprior.render.frames import draw, unpacked
from geoprior.scene.fingers import box_points
from geoprior.scene.hand import hand_cube
from geoprior.scene.mesh import flat_hull, square

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from geoprior.hooks.types import Renderer
    from geoprior.motions.trajectory import HandWay, Trajectory
    from geoprior.scene.arm import Arm
    from geoprior.scene.hand import Hand
    from geoprior.scene.scene import Scene

THIRD = "third"


def shots(scene: Scene, trajectory: Trajectory, seed: int = 0) -> dict[str, Shot]:
    """The shot of each camera, by name in alphabetical order.

    Args:
        scene: What is there.
        trajectory: How it moves.
        seed: See `Shot`.
    """
    world = np.eye(4)
    moved = ways_of_objects(scene, trajectory)
    floor = square(scene.floor.side, scene.floor.height)
    seen = [Cloud("floor", scene.floor.points, world, floor)]
    seen += [Cloud(name, each.points, moved[name], each.mesh) for name, each in scene.objects.items()]
    if trajectory.marker_points is not None:
        surface = trajectory.marker_surface or flat_hull(trajectory.marker_points)
        seen.append(Cloud("marker", trajectory.marker_points, world, surface))
    ways = trajectory.hands
    seen += [
        Cloud("distractor", each.points, each.transform_object_to_world, each.mesh)
        for each in scene.distractors
    ]
    cubes = {name: _cube(hand, ways[name]) for name, hand in scene.hands.items()}
    seen += [finger for name, hand in scene.hands.items() for finger in _fingers(hand, ways[name])]
    arms = [link for name, arm in scene.arms.items() for link in _arm(arm, scene.hands[name], ways[name])]
    made = {THIRD: Shot(scene.third_view, (*seen, *cubes.values(), *arms), trajectory.steps, seed)}
    for name, hand in scene.hands.items():
        others = (cube for other, cube in cubes.items() if other != name)
        made[name] = Shot(_riding(hand, ways[name]), (*seen, *others), trajectory.steps, seed)
    return {name: made[name] for name in sorted(made)}


def _cube(hand: Hand, way: HandWay) -> Cloud:
    return Cloud("hand", hand.points, way.transforms_hand_to_world, hand_cube(hand.cube, hand.setback))


def _fingers(hand: Hand, way: HandWay) -> Iterator[Cloud]:
    """Both fingers, as far apart as the way says."""
    fingers = hand.fingers
    if fingers is None:
        return
    aside = np.zeros((len(way.gripper), 3))
    aside[:, 0] = 0.5 * fingers.gaps(way.fingers_apart(), way.grip)
    for solid, side in zip(fingers.pair(), (1.0, -1.0), strict=True):
        at = way.transforms_hand_to_world @ make_transform(np.eye(3), side * aside)
        yield Cloud("finger", box_points(solid, fingers.points), at, solid)


def _arm(arm: Arm, hand: Hand, way: HandWay) -> Iterator[Cloud]:
    for solid, at in arm.boxes(hand, way.transforms_hand_to_world):
        yield Cloud("arm", box_points(solid, arm.points), at, solid)


def _riding(hand: Hand, way: HandWay) -> View:
    cameras = way.transforms_hand_to_world @ hand.transform_camera_to_hand
    return View(invert(cameras), hand.view.intrinsics, hand.view.height, hand.view.width)


def render(renderer: Renderer, shot: Shot) -> NDArray[np.uint8]:
    """Frames (N, H, W) of one camera, of a binary renderer 0 or 255; or (N, H, W, 3) RGB.

    Raises:
        PluginError: See `geoprior.render.frames.draw`.
    """
    return unpacked(renderer.frames, draw(renderer, shot), shot.view.width)
