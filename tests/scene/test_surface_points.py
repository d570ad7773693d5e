"""Surface points of every primitive: on the surface, and uniform by area over faces and within a face."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chisquare

from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.scene.mesh import sample_surface

PRIMITIVES = ("cone", "cylinder", "prism", "pyramid", "sphere", "truncated-cone", "truncated-pyramid")
COUNT = 10_000
UNLIKELY = 1e-6
"""Of a chi-square test; some thousands are made."""


def corners_of(mesh):
    """(F, 3, 3): each face's three corners."""
    return mesh.vertices[mesh.faces]


def areas_of(mesh):
    a, b, c = np.moveaxis(corners_of(mesh), 1, 0)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def barycentric(triangles, points):
    """Weights (P, F, 3) of every point's projection onto every face, and distances (P, F) from its plane."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    across = np.cross(b - a, c - a)
    double = np.linalg.norm(across, axis=1, keepdims=True)

    def above(normal, start):
        return points @ normal.T - np.sum(normal * start, axis=1)

    first = above(np.cross(across, c - b) / double**2, b)
    second = above(np.cross(across, a - c) / double**2, c)
    return np.stack([first, second, 1.0 - first - second], axis=-1), np.abs(above(across / double, a))


def located(mesh, points):
    """The face (P,) that each point lies on, and its barycentric weights (P, 3) there."""
    faces, found = [], []
    for part in np.array_split(points, 1 + len(points) * len(mesh.faces) // 200_000):
        weights, distances = barycentric(corners_of(mesh), part)
        off = np.maximum(distances / 1e-12, np.maximum(0.0, -weights.min(axis=-1)) / 1e-9)
        nearest = np.argmin(off, axis=1)
        assert off[np.arange(len(part)), nearest].max() <= 1.0, "every point lies on a face"
        faces.append(nearest)
        found.append(weights[np.arange(len(part)), nearest])
    return np.concatenate(faces), np.concatenate(found)


def merged(counts, expected, least=8.0):
    """Neighbouring classes put together until each expects enough for a chi-square test."""
    total = np.cumsum(expected)
    groups = np.minimum((total - 1e-9) // least, total[-1] // least - 1).astype(int)
    groups = np.unique(groups, return_inverse=True)[1]
    return np.bincount(groups, counts), np.bincount(groups, expected)


def p_over_faces(faces, areas):
    counts = np.bincount(faces, minlength=len(areas))
    return chisquare(*merged(counts, areas / areas.sum() * counts.sum())).pvalue


def p_within_faces(weights):
    """On a triangle the square of 1 - w_0 and the ratio of w_2 to w_1 + w_2 are uniform and independent."""
    along = (1.0 - weights[:, 0]) ** 2
    across = weights[:, 2] / (weights[:, 1] + weights[:, 2])
    return chisquare(np.histogram2d(along, across, bins=8, range=[[0, 1], [0, 1]])[0].ravel()).pvalue


def assert_uniform(name, seed):
    rng = np.random.default_rng(seed)
    mesh = plugins().build("primitive", Choice(name=name)).sample(rng)
    faces, weights = located(mesh, sample_surface(mesh, COUNT, rng))
    assert p_over_faces(faces, areas_of(mesh)) > UNLIKELY
    assert p_within_faces(weights) > UNLIKELY
    largest = weights[faces == np.argmax(areas_of(mesh))]
    if len(largest) > 640:
        assert p_within_faces(largest) > UNLIKELY


@pytest.mark.parametrize("name", PRIMITIVES)
def test_points_are_uniform_by_area(name):
    assert_uniform(name, 0)
    assert_uniform(name, 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", PRIMITIVES)
def test_points_are_uniform_by_area_over_a_thousand_solids(name):
    for seed in range(150):
        assert_uniform(name, seed)


def test_the_chi_square_tests_can_fail():
    rng = np.random.default_rng(0)
    mesh = plugins().build("primitive", Choice(name="truncated-pyramid")).sample(rng)
    areas = areas_of(mesh)
    any_face = rng.integers(len(areas), size=COUNT)
    assert p_over_faces(any_face, areas) < UNLIKELY, "every face as likely, whatever its area"
    denser = areas * np.where(areas == areas.max(), 1.4, 1.0)
    favoured = rng.choice(len(areas), COUNT, p=denser / denser.sum())
    assert p_over_faces(favoured, areas) < UNLIKELY, "the largest face too dense"
    plain = rng.dirichlet([1.0, 1.0, 1.0], COUNT)
    assert p_within_faces(plain) > UNLIKELY
    s, r = rng.random((2, COUNT))
    no_root = np.column_stack([1.0 - s, s * (1.0 - r), s * r])
    assert p_within_faces(no_root) < UNLIKELY, "the square root forgotten"
    assert p_within_faces(rng.dirichlet([1.0, 1.0, 1.2], COUNT)) < UNLIKELY, "a slight pull to one corner"
