from dataclasses import replace

import numpy as np
import pytest

from geoprior.geometry.interpolate import rotations_about
from geoprior.geometry.se3 import make_transform
from geoprior.scene.mesh import convex_mesh
from geoprior.view.outline import Outline, Solid

CUBE = convex_mesh(np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float))


def outline(mesh, transform=None):
    pose = np.eye(4) if transform is None else transform
    return Outline(Solid("object", mesh, pose), pose, (1, 2, 3))


def lengths(lines):
    return np.linalg.norm(lines.segments[:, 0] - lines.segments[:, 1], axis=1)


def ball(count=400):
    """Points spread evenly over the unit sphere, along a spiral."""
    z = 1 - 2 * (np.arange(count) + 0.5) / count
    turn = np.pi * (1 + 5**0.5) * np.arange(count)
    level = np.sqrt(1 - z * z)
    return convex_mesh(np.column_stack([level * np.cos(turn), level * np.sin(turn), z]))


@pytest.mark.parametrize(
    ("eye", "before", "behind"), [((5, 4, 3), 9, 3), ((5, 4, 0), 7, 5), ((5, 0, 0), 4, 8), ((0, 0, -9), 4, 8)]
)
def test_a_cube_shows_as_many_edges_as_one_sees_and_no_diagonal(eye, before, behind):
    seen, hidden = outline(CUBE).lines(np.array(eye, float))
    assert (len(seen.segments), len(hidden.segments)) == (before, behind)
    np.testing.assert_allclose(np.concatenate([lengths(seen), lengths(hidden)]), 2.0)
    assert hidden.strength < seen.strength


def test_a_cube_that_is_moved_is_seen_as_from_an_eye_that_is_moved():
    transform = make_transform(rotations_about(np.array([0.6, 0, 0.8]), np.array([0.7]))[0], np.ones(3))
    eye = np.array([5.0, 4.0, 3.0])
    here, there = (
        outline(CUBE).lines(eye)[0],
        outline(CUBE, transform).lines(transform[:3, :3] @ eye + 1.0)[0],
    )
    moved = here.segments @ transform[:3, :3].T + 1.0
    np.testing.assert_allclose(there.segments, moved, atol=1e-12)


def test_a_ball_is_drawn_as_a_circle_around_the_line_of_sight():
    eye = np.array([0.0, 6.0, 8.0])
    seen, hidden = outline(ball()).lines(eye)
    assert len(hidden.segments) == 0
    depth = seen.segments.reshape(-1, 3) @ (eye / 10.0)
    np.testing.assert_allclose(depth, 0.1, atol=0.15)  # the horizon of an eye 10 radii away
    assert lengths(seen).sum() == pytest.approx(2 * np.pi, rel=0.35)  # edge by edge, in zigzag


def test_the_rim_of_a_surface_that_is_not_closed_is_drawn():
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    sheet = replace(CUBE, vertices=np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float), faces=faces)
    seen, _ = outline(sheet).lines(np.array([0.2, 0.3, 4.0]))
    np.testing.assert_allclose(lengths(seen), np.ones(4))


def test_a_triangle_without_area_does_no_harm():
    flat = replace(CUBE, faces=np.vstack([CUBE.faces, [[0, 0, 1]]]))
    for lines in outline(flat).lines(np.array([5.0, 4.0, 3.0])):
        assert np.isfinite(lines.segments).all()
