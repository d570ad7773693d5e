"""At its end the object covers its marker, seen from above: by two methods that share nothing."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from motion_material import PRIMITIVES, ROOT_SEED
from scipy.spatial import ConvexHull

from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.se3 import apply
from geoprior.options import Choice
from geoprior.scene.config import MarkerConfig, ObjectConfig, SceneConfig
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import stage_episode

CELL = 0.001
CANVAS, SUBPIXELS = 1024, 16


def dense_take(motion, index, object_density, marker_density):
    scene = SceneConfig(
        object=ObjectConfig(density=object_density), marker=MarkerConfig(density=marker_density)
    )
    primitive = Choice(name=PRIMITIVES[index % len(PRIMITIVES)])
    config = GenerateConfig(fps=10, seconds=1, scene=scene, primitives=[primitive])
    return stage_episode(config, CamerasConfig(), ROOT_SEED, Choice(name=motion), index)


def cells(points):
    """Cells of 1 mm that the points fall into, seen from above."""
    grid = np.zeros((1200, 1200), dtype=bool)
    rows, columns = np.floor(points[:, :2] / CELL).astype(int).T + 600
    grid[rows, columns] = True
    return grid


def overlap_of_cells(one, other):
    one, other = cells(one), cells(other)
    return np.sum(one & other) / np.sum(one | other)


def filled(polygons, low, high):
    """Union of convex polygons, each (C, 2) metres, on a canvas of 1024 pixels that spans low to high."""
    canvas = np.zeros((CANVAS, CANVAS), dtype=np.uint8)
    scale = (CANVAS - 1) * SUBPIXELS / (high - low).max()
    for corners in polygons:
        cv2.fillConvexPoly(canvas, np.round((corners - low) * scale).astype(np.int32), 1, shift=4)
    return canvas.astype(bool)


def overlap_of_outlines(mesh, transform_object_to_world, marker):
    """The solid's own triangles, seen from above, against the hull of the marker's points."""
    triangles = apply(transform_object_to_world, mesh.vertices)[mesh.faces][:, :, :2]
    hull = marker[ConvexHull(marker[:, :2]).vertices, :2]
    corners = np.vstack([triangles.reshape(-1, 2), hull])
    span = corners.min(axis=0), corners.max(axis=0)
    one, other = filled(triangles, *span), filled([hull], *span)
    return np.sum(one & other) / np.sum(one | other)


def assert_covers(take):
    mesh, marker = take.scene.object.mesh, take.trajectory.marker_points
    start, end = take.trajectory.transforms_object_to_world[[0, -1]]
    assert overlap_of_outlines(mesh, end, marker) >= 0.98
    assert overlap_of_outlines(mesh, start, marker) < 0.6, "it can fail"


@pytest.mark.parametrize("motion", ["place", "push"])
def test_the_outlines_overlap_by_98_per_cent(motion):
    for index in range(6 * len(PRIMITIVES)):
        assert_covers(dense_take(motion, index, 1.0, 4e6))


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["place", "push"])
def test_the_outlines_overlap_by_98_per_cent_over_thousands_of_seeds(motion):
    for index in range(150 * len(PRIMITIVES)):
        assert_covers(dense_take(motion, index, 1.0, 4e6))


@pytest.mark.parametrize("motion", ["place", "push"])
def test_dense_points_fall_into_the_same_cells_by_98_per_cent(motion):
    for index in range(len(PRIMITIVES)):
        take = dense_take(motion, index, 2e7, 2e7)
        points, poses = take.scene.object.points, take.trajectory.transforms_object_to_world
        assert overlap_of_cells(apply(poses[-1], points), take.trajectory.marker_points) >= 0.98
        assert overlap_of_cells(apply(poses[0], points), take.trajectory.marker_points) < 0.6, "it can fail"
