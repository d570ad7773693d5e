"""The frames of a planned episode, and what they should be by a slow reference that shares no code."""

from __future__ import annotations

import numpy as np

from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.render import rig

HAND_FOV, THIRD_FOV = 75.0, 50.0
BEHIND_THE_HAND = 0.1
NEAREST = 0.01


def renderer(footprint):
    return plugins().build("renderer", Choice(name="points", options={"footprint": footprint}))


def unpacked_frames(scene, trajectory, footprint=2):
    """Frames (N, H, W) of each camera by name, 0 or 255, as the package draws them."""
    drawn = renderer(footprint)
    return {name: rig.render(drawn, shot) for name, shot in rig.shots(scene, trajectory).items()}


def packed_frames(scene, trajectory, footprint=2):
    """The same, eight pixels a byte (N, H, ceil(W / 8)), as the renderer gives them."""
    drawn, shots = renderer(footprint), rig.shots(scene, trajectory)
    return {name: drawn.render(shot) for name, shot in shots.items()}


def moved(points, transform):
    return points @ transform[:3, :3].T + transform[:3, 3]


def reference_frame(points, position, axes, fov, size, footprint=2):
    """One frame (H, W), 0 or 255, by the pinhole equations.

    Args:
        points: (P, 3) world.
        position: (3,) of the camera.
        axes: (3, 3) columns right, down and forward of the camera in the world.
        fov: Vertical field of view, degrees.
        size: Rows and columns.
        footprint: A point at (u, v) covers as many columns from floor(u + 1 - footprint / 2) on; rows too.
    """
    height, width = size
    local = (points - position) @ axes
    x, y, depth = local[local[:, 2] > NEAREST].T
    focal = height / 2 / np.tan(np.radians(fov) / 2)
    left = np.floor(focal * x / depth + (width - 1) / 2 + 1 - footprint / 2)
    top = np.floor(focal * y / depth + (height - 1) / 2 + 1 - footprint / 2)
    side = np.arange(footprint)
    rows, columns = np.broadcast_arrays((top[:, None] + side)[:, :, None], (left[:, None] + side)[:, None])
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    frame = np.zeros(size, dtype=np.uint8)
    frame[rows[inside].astype(int), columns[inside].astype(int)] = 255
    return frame


def hand_camera(pose):
    """Position and axes of the camera behind a hand: it looks forward, and the hand's up is up."""
    right, up, forward = pose[:3, :3].T
    return pose[:3, 3] - BEHIND_THE_HAND * forward, np.column_stack([-right, -up, forward])


def third_camera(view):
    axes = view.transforms_world_to_camera[:3, :3].T
    return -axes @ view.transforms_world_to_camera[:3, 3], axes


def reference_frames(scene, trajectory, footprint=2):
    """What `unpacked_frames` should give: floor, object and marker in both views, the hand's cube in one."""
    size = scene.third_view.height, scene.third_view.width
    marker = np.zeros((0, 3)) if trajectory.marker_points is None else trajectory.marker_points
    frames = {"hand": [], "third": []}
    for hand, body in zip(
        trajectory.hand.transforms_hand_to_world, trajectory.transforms_object_to_world, strict=True
    ):
        world = np.vstack([scene.floor.points, moved(scene.object.points, body), marker])
        cube = moved(scene.hand.points, hand)
        frames["hand"].append(reference_frame(world, *hand_camera(hand), HAND_FOV, size, footprint))
        everything = np.vstack([world, cube])
        third = third_camera(scene.third_view)
        frames["third"].append(reference_frame(everything, *third, THIRD_FOV, size, footprint))
    return {name: np.stack(views) for name, views in frames.items()}
