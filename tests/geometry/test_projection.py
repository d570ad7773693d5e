"""The pinhole equations, and what counts as in view."""

from __future__ import annotations

import numpy as np
import pytest

from geoprior.geometry.camera import pinhole_intrinsics
from geoprior.geometry.projection import View, in_view, project

IDENTITY = np.eye(4)


def view(height=100, width=200, fov=90.0):
    return View(IDENTITY, pinhole_intrinsics(height, width, fov), height, width)


def test_the_axis_meets_the_middle_and_the_field_of_view_the_edges():
    k = pinhole_intrinsics(100, 200, 90.0)
    pixels, depth = project(np.array([[0.0, 0.0, 2.0], [0.0, 2.0, 2.0], [4.0, 0.0, 2.0]]), IDENTITY, k)
    np.testing.assert_allclose(pixels, [[99.5, 49.5], [99.5, 99.5], [199.5, 49.5]])
    np.testing.assert_array_equal(depth, 2.0)


@pytest.mark.parametrize(
    ("point", "margin", "inside"),
    [
        ([0.0, 0.0, 1.0], 0.0, True),
        ([0.0, 0.0, -1.0], 0.0, False),
        ([0.0, 0.0, 0.0], 0.0, False),
        ([1.99, 0.99, 1.0], 0.0, True),
        ([2.01, 0.0, 1.0], 0.0, False),
        ([0.0, -1.01, 1.0], 0.0, False),
        ([0.0, 0.97, 1.0], 0.02, False),
        ([0.0, 0.95, 1.0], 0.02, True),
        ([1.97, 0.0, 1.0], 0.02, False),
    ],
)
def test_in_view(point, margin, inside):
    assert in_view(view(), np.array([point]), margin) is inside
    assert in_view(view(400, 800), np.array([point]), margin) is inside, "resolution must not matter"


def test_one_point_outside_is_enough():
    assert not in_view(view(), np.array([[0.0, 0.0, 1.0], [0.0, 5.0, 1.0]]))
