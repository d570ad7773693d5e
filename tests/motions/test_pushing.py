"""Push: the direction of the paper's equation."""

from __future__ import annotations

import numpy as np
import pytest

from geoprior.motions.push import push_direction, push_rotation


@pytest.mark.parametrize("seed", range(20))
def test_direction_is_the_horizontal_unit_vector(seed):
    centre, goal = np.random.default_rng(seed).normal(size=(2, 3))
    direction = push_direction(centre, goal)
    assert direction[2] == 0.0
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    np.testing.assert_allclose(np.cross(direction, goal - centre)[2], 0.0, atol=1e-12)
    assert direction @ (goal - centre) > 0.0
    assert np.linalg.det(push_rotation(direction)) == pytest.approx(1.0)


def test_a_push_of_no_distance_goes_along_x():
    np.testing.assert_array_equal(push_direction(np.ones(3), np.ones(3)), [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(push_direction(np.ones(3), np.array([1.0, 1.0, 7.0])), [1.0, 0.0, 0.0])
