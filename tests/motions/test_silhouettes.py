"""At its end the object covers its marker, seen from above."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.se3 import apply
from geoprior.options import Choice
from geoprior.scene.config import MarkerConfig, ObjectConfig, SceneConfig
from geoprior.shards.config import GenerateConfig
from geoprior.shards.synthesis import stage_episode

CELL = 0.001
DENSITY = 2e7


def silhouette(points):
    """Cells of 1 mm that the points fall into, seen from above."""
    grid = np.zeros((1200, 1200), dtype=bool)
    rows, columns = np.floor(points[:, :2] / CELL).astype(int).T + 600
    grid[rows, columns] = True
    return grid


@pytest.mark.parametrize("motion", ["place", "push"])
def test_dense_silhouettes_overlap_by_98_per_cent(motion):
    scene = SceneConfig(object=ObjectConfig(density=DENSITY), marker=MarkerConfig(density=DENSITY))
    config = GenerateConfig(fps=10, seconds=1, scene=scene)
    for index in range(7):
        take = stage_episode(config, CamerasConfig(), 5, Choice(name=motion), index)
        placed = apply(take.trajectory.transforms_object_to_world[-1], take.scene.object.points)
        ends, marker = silhouette(placed), silhouette(take.trajectory.marker_points)
        overlap = np.sum(ends & marker) / np.sum(ends | marker)
        assert overlap >= 0.98
        starts = silhouette(apply(take.scene.object.transform_object_to_world, take.scene.object.points))
        assert np.sum(starts & marker) / np.sum(starts | marker) < 0.5, "the test must be able to fail"


@pytest.mark.parametrize("motion", ["place", "push"])
def test_the_marker_lies_within_the_outline_of_the_placed_object_and_fills_it(takes, motion):
    for take in takes(motion):
        vertices = apply(take.trajectory.transforms_object_to_world[-1], take.scene.object.mesh.vertices)
        outline = ConvexHull(vertices[:, :2])
        marker = take.trajectory.marker_points[:, :2]
        outside = marker @ outline.equations[:, :2].T + outline.equations[:, 2]
        assert outside.max() < 1e-9
        assert ConvexHull(marker).volume > 0.6 * outline.volume
