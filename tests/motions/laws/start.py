"""The scene before anything moves."""

from __future__ import annotations

import numpy as np

from geoprior.geometry.se3 import apply

HAND_FOV, THIRD_FOV = 75.0, 50.0
BEHIND_THE_HAND = 0.1
AIM = 0.05


def pixels(points, position, axes, fov, size):
    """(P, 2) rows and columns, and depths, of a camera with columns [right, down, forward] for axes."""
    local = (points - position) @ axes
    focal = 0.5 * size[0] / np.tan(np.radians(fov) / 2.0)
    middle = 0.5 * (np.array(size) - 1.0)
    return focal * local[:, [1, 0]] / local[:, 2:] + middle, local[:, 2]


def assert_in_frame(points, position, axes, fov, size):
    found, depth = pixels(points, position, axes, fov, size)
    assert depth.min() > 0.0
    assert found.min() >= 0.0
    assert np.all(found.max(axis=0) <= np.array(size) - 1.0)


def third_camera(take):
    """Where the third-person camera is, and its axes [right, down, forward] as columns."""
    to_camera = take.scene.third_view.transforms_world_to_camera
    axes = to_camera[:3, :3].T
    return -axes @ to_camera[:3, 3], axes


def the_object_rests_upright_on_the_floor(take):
    scene = take.scene
    vertices = scene.object.vertices
    assert abs(vertices[:, 2].min() - scene.floor.height) <= 1e-9
    turn = scene.object.transform_object_to_world[:3, :3]
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(turn[:, 2], [0.0, 0.0, 1.0], atol=1e-12)
    assert np.linalg.det(turn) > 0.0
    assert np.abs(scene.object.centre[:2]).max() <= 0.15
    assert np.abs(vertices[:, :2]).max() <= 0.5 * scene.floor.side
    np.testing.assert_allclose(
        vertices.min(axis=0)[2] + vertices.max(axis=0)[2], 2.0 * scene.object.centre[2]
    )


def the_hand_starts_above_the_floor_and_the_object(take):
    scene = take.scene
    assert 0.15 - 1e-9 <= scene.hand.position[2] - scene.floor.height <= 0.45 + 1e-9
    assert scene.hand.position[2] - scene.object.vertices[:, 2].max() >= 0.05 - 1e-9
    assert np.linalg.norm((scene.hand.position - scene.object.centre)[:2]) <= 0.2 + 1e-9


def the_hand_points_near_the_object(take):
    hand, centre = take.scene.hand, take.scene.object.centre
    forward = hand.transform_hand_to_world[:3, 2]
    meets = hand.position + (centre[2] - hand.position[2]) / forward[2] * forward
    assert forward[2] < 0.0
    assert np.linalg.norm(meets - centre) <= AIM + 1e-9


def the_hand_camera_has_the_object_in_its_first_frame(take):
    view, pose = take.scene.hand.view, take.scene.hand.transform_hand_to_world
    right, up, forward = pose[:3, :3].T
    position, axes = pose[:3, 3] - BEHIND_THE_HAND * forward, np.column_stack([-right, -up, forward])
    assert_in_frame(take.scene.object.vertices, position, axes, HAND_FOV, (view.height, view.width))
    np.testing.assert_allclose(view.transforms_world_to_camera[:3, :3], axes.T, atol=1e-12)
    np.testing.assert_allclose(view.transforms_world_to_camera[:3, 3], -axes.T @ position, atol=1e-12)


def the_third_camera_has_object_and_hand_in_its_first_frame(take):
    scene, view = take.scene, take.scene.third_view
    size = view.height, view.width
    line = np.array([-0.5, 0.5]) * scene.hand.cube
    corners = np.stack(np.meshgrid(line, line, [-scene.hand.cube, 0.0]), axis=-1).reshape(-1, 3)
    cube = apply(scene.hand.transform_hand_to_world, corners)
    assert_in_frame(np.vstack([scene.object.vertices, cube]), *third_camera(take), THIRD_FOV, size)


def the_third_camera_is_above_the_floor_and_looks_at_the_midpoint(take):
    scene, view = take.scene, take.scene.third_view
    position, axes = third_camera(take)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.cross(axes[:, 0], axes[:, 1]), axes[:, 2], atol=1e-12)
    assert position[2] > max(scene.floor.height, scene.object.vertices[:, 2].max())
    assert axes[2, 1] < 0.0, "world up points up in the image"
    assert abs(axes[2, 0]) < 1e-12, "and the horizon is level"
    midpoint = 0.5 * (scene.object.centre + scene.hand.position)
    size = view.height, view.width
    found, depth = pixels(midpoint[None], position, axes, THIRD_FOV, size)
    np.testing.assert_allclose(found[0], 0.5 * (np.array(size) - 1.0), atol=1e-6)
    assert 0.6 - 1e-9 <= depth[0] <= 1.3 + 1e-9


START = (
    the_object_rests_upright_on_the_floor,
    the_hand_starts_above_the_floor_and_the_object,
    the_hand_points_near_the_object,
    the_hand_camera_has_the_object_in_its_first_frame,
    the_third_camera_has_object_and_hand_in_its_first_frame,
    the_third_camera_is_above_the_floor_and_looks_at_the_midpoint,
)
"""Of every motion: what both first frames need."""
