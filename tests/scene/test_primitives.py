"""Every registered solid, over many draws."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from geoprior.errors import ConfigError
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.scene.mesh import bounds, extents
from geoprior.scene.solids import polygon

BUILTIN = ("cone", "cylinder", "prism", "pyramid", "sphere", "truncated-cone", "truncated-pyramid")
DRAWS = 60


def draws(name, count=DRAWS, **options):
    primitive = plugins().build("primitive", Choice(name=name, options=options))
    return [primitive.sample(np.random.default_rng(seed)) for seed in range(count)]


def signed_volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return float(np.sum(np.cross(a, b) * c) / 6.0)


def test_all_are_registered():
    assert set(BUILTIN) <= set(plugins().names("primitive"))


@pytest.mark.parametrize("name", BUILTIN)
def test_closed_outward_convex_and_centred(name):
    for mesh in draws(name):
        edges = Counter((int(face[i]), int(face[(i + 1) % 3])) for face in mesh.faces for i in range(3))
        assert all(count == 1 and edges[b, a] == 1 for (a, b), count in edges.items()), "not closed"
        volume = signed_volume(mesh)
        assert volume == pytest.approx(ConvexHull(mesh.vertices).volume, rel=1e-9), (
            "inside out, or not convex"
        )
        np.testing.assert_allclose(np.add(*bounds(mesh)), 0.0, atol=1e-12)


@pytest.mark.parametrize("name", BUILTIN)
def test_sizes_spread_over_a_wide_range(name):
    sizes = np.array([extents(mesh) for mesh in draws(name, 200)])
    assert sizes.min() > 0.009
    assert sizes.max() < 0.15
    assert np.quantile(sizes[:, 2], 0.9) > 2.0 * np.quantile(sizes[:, 2], 0.1)


@pytest.mark.parametrize("name", BUILTIN)
def test_the_same_generator_gives_the_same_solid(name):
    first, second = draws(name, 3), draws(name, 3)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
        assert one.parameters == other.parameters


@pytest.mark.parametrize("name", ["prism", "pyramid", "truncated-pyramid"])
def test_every_number_of_sides_occurs_and_bases_are_slightly_distorted(name):
    sides = Counter()
    for mesh in draws(name, 200, stretched=0.0):
        count = int(mesh.parameters["sides"])
        base = mesh.vertices[mesh.vertices[:, 2] < mesh.vertices[:, 2].min() + 1e-9]
        assert len(base) == count
        radii = np.linalg.norm(base[:, :2] - base[:, :2].mean(axis=0), axis=1)
        assert 0.0 < np.ptp(radii) / radii.max() < 0.5
        sides[count] += 1
    assert sorted(sides) == [3, 4, 5, 6, 7, 8]


def test_prisms_do_not_narrow_and_pyramids_come_to_a_point():
    for mesh in draws("prism"):
        assert sum(mesh.vertices[:, 2] > 0) == mesh.parameters["sides"]
    for name in ("pyramid", "cone"):
        for mesh in draws(name):
            assert sum(mesh.vertices[:, 2] > 0) == 1


@pytest.mark.parametrize("name", ["truncated-pyramid", "truncated-cone"])
def test_tops_are_narrower_by_the_drawn_share(name):
    for mesh in draws(name):
        low, high = mesh.vertices[mesh.vertices[:, 2] < 0], mesh.vertices[mesh.vertices[:, 2] > 0]
        share = np.ptp(high[:, 0]) / np.ptp(low[:, 0])
        assert share == pytest.approx(mesh.parameters["top"])


def test_spheres_are_round_and_stretched_ones_ellipsoids():
    for mesh in draws("sphere", stretched=0.0):
        radii = np.linalg.norm(mesh.vertices, axis=1)
        assert np.ptp(radii) / radii.max() < 0.02
        ball = np.pi * mesh.parameters["diameter"] ** 3 / 6
        assert signed_volume(mesh) == pytest.approx(ball, rel=0.02)
    stretched = draws("sphere", stretched=1.0)
    ratios = [extents(mesh).max() / extents(mesh).min() for mesh in stretched]
    assert np.median(ratios) > 1.1


def test_some_solids_are_stretched_and_some_are_not():
    plain = [mesh.parameters["stretch_x"] == 1.0 for mesh in draws("cylinder", 100)]
    assert 25 < sum(plain) < 75


def test_polygons_are_convex_even_when_distorted_most():
    rng = np.random.default_rng(0)
    for sides in range(3, 9):
        for _ in range(200):
            corners = polygon(sides, 0.25, rng)
            edges = np.roll(corners, -1, axis=0) - corners
            turns = np.cross(edges, np.roll(edges, -1, axis=0))
            assert np.all(turns > 0.0)
            assert np.linalg.norm(corners, axis=1).max() <= 0.5


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({"width": [0.1, 0.05]}, "width"),
        ({"height": [0.0, 0.1]}, "height"),
        ({"sides": [2, 5]}, "sides"),
        ({"colour": "red"}, "colour"),
        ({"stretch": 2.0}, "stretch"),
    ],
)
def test_bad_options_are_named(options, key):
    with pytest.raises(ConfigError, match=key):
        plugins().options("primitive", Choice(name="prism", options=options))
