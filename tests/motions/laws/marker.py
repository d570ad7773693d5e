"""The goal drawn on the floor."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from geoprior.geometry.se3 import apply
from laws.start import THIRD_FOV, pixels, third_camera


def outline(transform_object_to_world, mesh):
    """The object's silhouette seen from above, as half-planes (E, 3)."""
    return ConvexHull(apply(transform_object_to_world, mesh.vertices)[:, :2]).equations


def outside(points, half_planes):
    """How far the farthest of the points lies outside, metres."""
    return (points[:, :2] @ half_planes[:, :2].T + half_planes[:, 2]).max()


def the_marker_lies_flat_on_the_floor_and_in_the_third_view(take):
    points, scene, view = take.trajectory.marker_points, take.scene, take.scene.third_view
    np.testing.assert_array_equal(points[:, 2], scene.floor.height)
    assert np.abs(points[:, :2]).max() <= 0.5 * scene.floor.side
    found, depth = pixels(points, *third_camera(take), THIRD_FOV, (view.height, view.width))
    assert depth.min() > 0.0
    assert found.min() >= 0.0
    assert np.all(found.max(axis=0) <= [view.height - 1.0, view.width - 1.0])


def the_marker_lies_at_its_distance_on_the_floor(take):
    start, goal = take.trajectory.transforms_object_to_world[[0, -1], :3, 3]
    assert 0.12 - 1e-9 <= np.linalg.norm(goal - start) <= 0.25 + 1e-9
    assert abs(goal[2] - start[2]) < 1e-9


def the_object_ends_on_its_marker(take):
    half_planes = outline(take.trajectory.transforms_object_to_world[-1], take.scene.object.mesh)
    points = take.trajectory.marker_points
    assert outside(points, half_planes) < 1e-9
    whole = ConvexHull(take.scene.object.mesh.vertices[:, :2]).volume
    assert ConvexHull(points[:, :2]).volume > 0.5 * whole, "and the marker fills its outline"


def the_marker_is_dense(take):
    mesh = take.scene.object.mesh
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert len(take.trajectory.marker_points) == max(32, round(30_000 * area))


MARKER = (
    the_marker_lies_flat_on_the_floor_and_in_the_third_view,
    the_marker_lies_at_its_distance_on_the_floor,
    the_object_ends_on_its_marker,
    the_marker_is_dense,
)
