import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoprior.geometry.camera import pinhole_intrinsics
from geoprior.geometry.projection import View, project
from geoprior.geometry.se3 import invert, look_at
from geoprior.view.canvas import BACKGROUND
from geoprior.view.marks import Dots, Label, Lines
from geoprior.view.painter import paint

HEIGHT, WIDTH = 240, 320
EYE = np.array([2.0, 1.0, 1.5])
VIEW = View(
    invert(look_at(EYE, np.zeros(3), np.array([0.0, 0.0, 1.0]))),
    pinhole_intrinsics(HEIGHT, WIDTH, 40.0),
    HEIGHT,
    WIDTH,
)
RED, BLUE = (255, 0, 0), (0, 0, 255)


def dot(*point, colour=RED, radius=0.02):
    return Dots(np.array([point], float), radius, colour)


def line(start, end, colour=BLUE, width=3):
    return Lines(np.array([[start, end]], float), width, colour)


def weight(picture):
    """(H, W) how far each pixel is from the ground."""
    return np.abs(picture.astype(int) - BACKGROUND).sum(axis=2)


def middle_of(picture):
    """(column, row) of what is painted, by weight."""
    weights = weight(picture)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.array([(columns * weights).sum(), (rows * weights).sum()]) / weights.sum()


coordinates = st.floats(-0.3, 0.3)


@given(coordinates, coordinates, coordinates)
def test_a_point_lands_where_the_pinhole_equations_say(x, y, z):
    pixels, _ = project(np.array([[x, y, z]]), VIEW.transforms_world_to_camera, VIEW.intrinsics)
    np.testing.assert_allclose(middle_of(paint([dot(x, y, z)], VIEW)), pixels[0], atol=0.15)


def test_what_is_looked_at_lands_in_the_middle():
    np.testing.assert_allclose(middle_of(paint([dot(0, 0, 0)], VIEW)), [159.5, 119.5], atol=0.1)


def test_a_line_lies_on_its_ends_and_not_beyond():
    ends = np.array([[-0.2, 0.1, 0.0], [0.1, 0.3, 0.2]])
    pixels, _ = project(ends, VIEW.transforms_world_to_camera, VIEW.intrinsics)
    rows, columns = np.nonzero(weight(paint([line(*ends, width=1)], VIEW)))
    np.testing.assert_allclose([columns.min(), columns.max()], np.sort(pixels[:, 0]), atol=2)
    np.testing.assert_allclose([rows.min(), rows.max()], np.sort(pixels[:, 1]), atol=2)


@pytest.mark.parametrize("nearer_first", [True, False])
@pytest.mark.parametrize("other", ["dot", "line"])
def test_what_is_nearer_lies_over_what_is_farther_in_whatever_order_it_comes(nearer_first, other):
    outward = EYE / np.linalg.norm(EYE)
    near = dot(*(0.2 * outward), radius=0.012)
    across = np.cross(outward, [0, 0, 1.0])
    far = (
        dot(0, 0, 0, colour=BLUE, radius=0.024)
        if other == "dot"
        else line(-0.1 * across, 0.1 * across, width=10)
    )
    picture = paint([near, far] if nearer_first else [far, near], VIEW)
    np.testing.assert_array_equal(picture[119, 159], RED)
    assert (picture == BLUE).all(axis=2).any()
    swapped = paint([dot(*(-0.2 * outward), radius=0.012), far], VIEW)
    np.testing.assert_array_equal(swapped[119, 159], BLUE)


def test_a_group_of_dots_fades_from_its_nearest_to_its_farthest():
    across = np.cross(EYE, [0, 0, 1.0]) / np.linalg.norm(EYE)
    outward = 0.3 * EYE / np.linalg.norm(EYE)
    points = np.array([outward - 0.2 * across, 0.2 * across - outward])
    picture = paint([Dots(points, 0.02, RED)], VIEW)
    pixels, _ = project(points, VIEW.transforms_world_to_camera, VIEW.intrinsics)
    (near, far) = (picture[round(row), round(column)] for column, row in pixels)
    np.testing.assert_array_equal(near, RED)
    assert BACKGROUND < far[0] < 180


def test_strength_is_how_far_a_mark_stands_out():
    strengths = [weight(paint([Dots(np.zeros((1, 3)), 0.02, RED, at)], VIEW)).sum() for at in (1.0, 0.5, 0.0)]
    assert strengths[0] > 1.8 * strengths[1] > 0
    assert strengths[2] == 0


def test_what_is_behind_the_camera_or_at_its_lens_is_not_drawn():
    behind, lens = 1.5 * EYE, EYE * (1 - 1e-4)
    marks = [dot(*behind), dot(*lens), dot(*EYE), line(behind, [0, 0, 0]), line(EYE, [0, 0, 0])]
    marks.append(Label(behind, "behind", RED))
    assert (paint(marks, VIEW) == BACKGROUND).all()


@pytest.mark.filterwarnings("error")
def test_what_is_far_outside_the_frame_does_no_harm():
    edge = EYE + 0.011 * -EYE / np.linalg.norm(EYE) + 50.0 * np.cross(EYE, [0, 0, 1.0])
    inside = dot(0, 0, 0)
    picture = paint([inside, dot(*edge), line(edge, [0, 0, 0]), line(edge, -edge)], VIEW)
    np.testing.assert_array_equal(picture, paint([inside], VIEW))


def test_nothing_is_a_blank_picture():
    empty = [Dots(np.zeros((0, 3)), 0.01, RED), Lines(np.zeros((0, 2, 3)), 1, RED)]
    for marks in ([], empty):
        picture = paint(marks, VIEW)
        assert picture.shape == (HEIGHT, WIDTH, 3)
        assert picture.dtype == np.uint8
        assert (picture == BACKGROUND).all()


def test_a_label_stands_above_its_point_to_the_right_and_within_the_frame():
    column, row = middle_of(paint([Label(np.zeros(3), "third", RED)], VIEW))
    assert 159 < column < 200
    assert 90 < row < 119
    wide = Label(np.array([0.0, 0.85, 0.0]), "a name that is rather long", RED)
    narrow = Label(np.array([0.0, 0.85, 0.0]), "a", RED)
    painted = weight(paint([wide], VIEW))
    assert weight(paint([narrow], VIEW)).any()
    assert painted.sum() > 5 * weight(paint([narrow], VIEW)).sum()
