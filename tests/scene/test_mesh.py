"""Meshes: closed, outward, centred; surface points uniform by area."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chisquare

from geoprior.scene.mesh import (
    bounds,
    centred,
    convex_mesh,
    extents,
    points_for_density,
    sample_surface,
    scaled,
)

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])


def signed_volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return np.sum(np.cross(a, b) * c) / 6.0


def test_the_hull_of_a_cube():
    mesh = convex_mesh(np.vstack([CUBE, [[0.5, 0.5, 0.5]]]))
    assert len(mesh.vertices) == 8, "the inner point is dropped"
    assert len(mesh.faces) == 12
    assert signed_volume(mesh) == pytest.approx(1.0)
    assert mesh.face_areas.sum() == pytest.approx(6.0)


def test_centring_and_stretching():
    mesh = centred(scaled(convex_mesh(CUBE), np.array([1.0, 2.0, 3.0])))
    np.testing.assert_allclose(extents(mesh), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(sum(bounds(mesh)), 0.0, atol=1e-12)
    assert signed_volume(mesh) == pytest.approx(6.0)


def test_points_are_uniform_by_area_between_faces_and_within_them():
    mesh = scaled(convex_mesh(CUBE), np.array([1.0, 2.0, 5.0]))
    points = sample_surface(mesh, 40_000, np.random.default_rng(0))
    on = {axis: points[np.isclose(points[:, axis], high)] for axis, high in enumerate((1.0, 2.0, 5.0))}
    areas = {0: 10.0, 1: 5.0, 2: 2.0}
    for axis, found in on.items():
        assert len(found) == pytest.approx(40_000 * areas[axis] / 34.0, rel=0.03)
        across = [other for other in range(3) if other != axis]
        unit = found[:, across] / np.array([1.0, 2.0, 5.0])[across]
        counts = np.histogram2d(*unit.T, bins=6, range=[[0, 1], [0, 1]])[0].ravel()
        assert chisquare(counts).pvalue > 1e-4


def test_points_lie_on_the_surface():
    mesh = centred(convex_mesh(CUBE))
    points = sample_surface(mesh, 500, np.random.default_rng(1))
    np.testing.assert_allclose(np.abs(points).max(axis=1), 0.5, atol=1e-12)


def test_the_number_of_points_follows_the_area():
    mesh = convex_mesh(CUBE)
    assert points_for_density(mesh, 100.0) == 600
    assert points_for_density(mesh, 0.001) == 32
