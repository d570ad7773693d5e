import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoprior.geometry.projection import project
from geoprior.geometry.se3 import invert
from geoprior.view.orbit import Angle, views_around

SIZE = (120, 200)
MARGIN = 0.05
degrees = st.floats(-720.0, 720.0)
elevations = st.floats(-90.0, 90.0)


def pixels_of(points, view):
    pixels, depth = project(points, view.transforms_world_to_camera, view.intrinsics)
    assert (depth > 0).all()
    return pixels


@given(st.integers(0, 2**32), degrees, elevations, st.floats(0.05, 10.0))
def test_every_point_is_in_the_picture_and_one_is_at_its_edge(seed, azimuth, elevation, size):
    points = np.random.default_rng(seed).normal(size=(20, 3)) * size + 5.0
    [view] = views_around(points, [Angle(azimuth, elevation)], SIZE, MARGIN)
    height, width = SIZE
    from_middle = np.abs(pixels_of(points, view) - [(width - 1) / 2, (height - 1) / 2])
    reach = from_middle / [width / 2 - MARGIN * height, height / 2 - MARGIN * height]
    assert reach.max() == pytest.approx(1.0, abs=1e-6)


@given(st.integers(0, 2**32), st.lists(degrees, min_size=2, max_size=5), elevations)
def test_an_orbit_keeps_its_distance_and_every_point_in_the_picture(seed, azimuths, elevation):
    points = np.random.default_rng(seed).normal(size=(20, 3))
    views = views_around(points, [Angle(azimuth, elevation) for azimuth in azimuths], SIZE, MARGIN)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    eyes = np.array([invert(view.transforms_world_to_camera)[:3, 3] for view in views])
    distances = np.linalg.norm(eyes - middle, axis=1)
    np.testing.assert_allclose(distances, distances[0])
    for view in views:
        pixels = pixels_of(points, view)
        assert (pixels > -0.5).all()
        assert (pixels < [SIZE[1] - 0.5, SIZE[0] - 0.5]).all()


@pytest.mark.parametrize(
    ("angle", "side"),
    [
        (Angle(0, 0), (1, 0, 0)),
        (Angle(90, 0), (0, 1, 0)),
        (Angle(-90, 0), (0, -1, 0)),
        (Angle(45, 90), (0, 0, 1)),
        (Angle(45, -90), (0, 0, -1)),
    ],
)
def test_the_camera_stands_where_the_angle_says(angle, side):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    [view] = views_around(corners, [angle], SIZE)
    eye = invert(view.transforms_world_to_camera)[:3, 3]
    np.testing.assert_allclose(eye / np.linalg.norm(eye), side, atol=1e-9)


@given(degrees, st.floats(-89.0, 89.0))
def test_up_is_up(azimuth, elevation):
    points = np.array([[0, 0, -1], [0, 0, 1], [1, 0, 0], [-1, 0, 0]], float)
    [view] = views_around(points, [Angle(azimuth, elevation)], SIZE)
    (low_column, low), (high_column, high) = pixels_of(points, view)[:2]
    assert high < low
    assert high_column == pytest.approx(low_column)


def test_a_whole_turn_is_the_same_view_to_the_last_bit():
    points = np.random.default_rng(0).normal(size=(9, 3))
    for azimuth in (-200.0, -35.0, 0.0, 35.0, 340.0):
        one, other = views_around(points, [Angle(azimuth), Angle(azimuth).turned(360.0)], SIZE)
        np.testing.assert_array_equal(one.transforms_world_to_camera, other.transforms_world_to_camera)


def test_a_single_point_can_be_looked_at():
    [view] = views_around(np.ones((1, 3)), [Angle()], SIZE)
    np.testing.assert_allclose(pixels_of(np.ones((1, 3)), view), [[99.5, 59.5]], atol=1e-6)
