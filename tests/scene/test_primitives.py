"""Every registered solid, over many draws."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare, kstest

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


def assert_closed_outward_and_convex(mesh):
    """Every edge joins two faces that run it opposite ways, and every face has all of the solid behind it."""
    edges = Counter((int(face[i]), int(face[(i + 1) % 3])) for face in mesh.faces for i in range(3))
    assert all(count == 1 and edges[b, a] == 1 for (a, b), count in edges.items())
    assert len(mesh.vertices) - len(edges) // 2 + len(mesh.faces) == 2, "one piece without holes (Euler)"
    assert set(mesh.faces.ravel()) == set(range(len(mesh.vertices)))
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.max(mesh.vertices @ normals.T - np.sum(normals * a, axis=1)) < 1e-12
    assert signed_volume(mesh) > 0.0
    np.testing.assert_allclose(np.add(*bounds(mesh)), 0.0, atol=1e-12)


def factors(mesh):
    return np.array([mesh.parameters[f"stretch_{axis}"] for axis in "xyz"])


def assert_has_its_size(name, mesh):
    """What the mesh measures is what was drawn: its size times its stretch."""
    sizes, stretch = extents(mesh), factors(mesh)
    width = mesh.parameters.get("width", mesh.parameters.get("diameter"))
    height = mesh.parameters.get("height", width)
    assert 0.02 <= width <= 0.12
    assert 0.02 <= height <= 0.12
    assert np.all(np.abs(stretch - 1.0) <= 0.2)
    across = sizes[:2] / (width * stretch[:2])
    if "sides" in mesh.parameters:
        assert np.all((across > 0.5) & (across <= 1.0 + 1e-12)), "the base lies in its circumcircle"
    else:
        np.testing.assert_allclose(across, 1.0, atol=0.01 if name == "sphere" else 1e-12)
    assert sizes[2] == pytest.approx(height * stretch[2], rel=0.005 if name == "sphere" else 1e-12)


def assert_base_is_slightly_distorted(mesh):
    """A regular polygon fits the base to within the distortion, and not exactly."""
    sides, radius = int(mesh.parameters["sides"]), 0.5 * mesh.parameters["width"]
    base = mesh.vertices[mesh.vertices[:, 2] < mesh.vertices[:, 2].min() + 1e-9]
    assert len(base) == sides
    corners = (base[:, 0] + 1j * base[:, 1] * factors(mesh)[0] / factors(mesh)[1]) / factors(mesh)[0]
    corners -= corners.mean()
    corners = corners[np.argsort(np.angle(corners))]
    regular = np.exp(2j * np.pi * np.arange(sides) / sides)
    fit = np.mean(corners / regular) * regular
    off = np.sqrt(np.mean(np.abs(corners - fit) ** 2))
    assert 0.0 < off <= 0.15 * radius * np.hypot(1.0, np.pi / sides)


def assert_sound(name, mesh):
    assert_closed_outward_and_convex(mesh)
    assert_has_its_size(name, mesh)
    if "sides" in mesh.parameters:
        assert_base_is_slightly_distorted(mesh)


@pytest.mark.parametrize("name", BUILTIN)
def test_closed_outward_convex_and_of_the_size_drawn(name):
    for mesh in draws(name):
        assert_sound(name, mesh)


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILTIN)
def test_every_solid_is_sound_over_thousands_of_seeds(name):
    for mesh in draws(name, 2000):
        assert_sound(name, mesh)


@pytest.mark.parametrize("harm", ["flip a face", "drop a face", "turn it inside out", "dent it"])
def test_harm_to_a_mesh_is_seen(harm):
    mesh = draws("truncated-pyramid", 1)[0]
    flipped, dented = mesh.faces.copy(), mesh.vertices.copy()
    flipped[0] = flipped[0, ::-1]
    dented[0] *= 0.5
    harmed = {
        "flip a face": replace(mesh, faces=flipped),
        "drop a face": replace(mesh, faces=mesh.faces[1:]),
        "turn it inside out": replace(mesh, faces=mesh.faces[:, ::-1]),
        "dent it": replace(mesh, vertices=dented),
    }
    with pytest.raises(AssertionError):
        assert_closed_outward_and_convex(harmed[harm])


@pytest.mark.parametrize("name", BUILTIN)
def test_sizes_and_stretches_are_uniform_over_their_ranges(name):
    """Every size from 2 to 12 cm as likely; half of the solids stretched, each axis on its own."""
    meshes = draws(name, 400)
    for key in {"width", "height", "diameter"} & set(meshes[0].parameters):
        values = [mesh.parameters[key] for mesh in meshes]
        assert kstest(values, "uniform", args=(0.02, 0.1)).pvalue > 1e-4
    stretches = np.array([factors(mesh) for mesh in meshes])
    stretched = stretches[np.any(stretches != 1.0, axis=1)]
    assert 150 < len(stretched) < 250
    for axis in range(3):
        assert kstest(stretched[:, axis], "uniform", args=(0.8, 0.4)).pvalue > 1e-4
    assert np.abs(np.corrcoef(stretched.T)[np.triu_indices(3, 1)]).max() < 0.3


@pytest.mark.parametrize("name", ["prism", "pyramid", "truncated-pyramid"])
def test_every_number_of_sides_occurs_as_often(name):
    sides = Counter(int(mesh.parameters["sides"]) for mesh in draws(name, 400))
    assert sorted(sides) == [3, 4, 5, 6, 7, 8]
    assert chisquare(list(sides.values())).pvalue > 1e-4


@pytest.mark.parametrize("name", ["prism", "pyramid", "truncated-pyramid"])
def test_without_distortion_bases_are_regular(name):
    for mesh in draws(name, 30, distortion=0.0, stretched=0.0):
        base = mesh.vertices[mesh.vertices[:, 2] < 0]
        radii = np.linalg.norm(base[:, :2] - base[:, :2].mean(axis=0), axis=1)
        np.testing.assert_allclose(radii, 0.5 * mesh.parameters["width"], rtol=1e-9)


def test_spheres_are_round_and_stretched_ones_ellipsoids():
    for stretched in (0.0, 1.0):
        for mesh in draws("sphere", stretched=stretched):
            axes = 0.5 * mesh.parameters["diameter"] * factors(mesh)
            np.testing.assert_allclose(np.linalg.norm(mesh.vertices / axes, axis=1), 1.0, atol=0.005)
            assert signed_volume(mesh) == pytest.approx(4.0 / 3.0 * np.pi * np.prod(axes), rel=0.02)
            assert (np.ptp(axes) > 0.0) == bool(stretched)


@given(st.integers(3, 8), st.floats(0.0, 0.25), st.integers(0, 2**32 - 1))
def test_polygons_are_convex_and_off_the_regular_one_by_no_more_than_the_distortion(sides, distortion, seed):
    corners = polygon(sides, distortion, np.random.default_rng(seed))
    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    assert np.all(edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] > 0.0)
    regular = 2.0 * np.pi * np.arange(sides) / sides
    radii, angles = np.linalg.norm(corners, axis=1), np.arctan2(corners[:, 1], corners[:, 0])
    assert np.all((radii >= 0.5 * (1.0 - distortion) - 1e-12) & (radii <= 0.5 + 1e-12))
    off = np.angle(np.exp(1j * (angles - regular)))
    assert np.abs(off).max() <= 0.5 * distortion * 2.0 * np.pi / sides + 1e-12


def test_distortions_use_their_whole_range():
    corners = np.concatenate([polygon(5, 0.2, np.random.default_rng(seed)) for seed in range(200)])
    radii, angles = np.linalg.norm(corners, axis=1), np.arctan2(corners[:, 1], corners[:, 0])
    off = np.angle(np.exp(1j * (angles - np.tile(2.0 * np.pi * np.arange(5) / 5, 200))))
    assert kstest(radii, "uniform", args=(0.4, 0.1)).pvalue > 1e-3
    assert kstest(off, "uniform", args=(-0.04 * np.pi, 0.08 * np.pi)).pvalue > 1e-3


@pytest.mark.parametrize("name", BUILTIN)
def test_the_same_generator_gives_the_same_solid(name):
    first, second = draws(name, 3), draws(name, 3)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
        assert one.parameters == other.parameters


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
