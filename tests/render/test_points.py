"""The renderer against a slow one written from the pinhole equations, pixel for pixel."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoprior.geometry.camera import pinhole_intrinsics
from geoprior.geometry.projection import View
from geoprior.geometry.se3 import make_transform
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.render import rig
from geoprior.render.clouds import Cloud, Shot
from geoprior.render.points import axes_first


class Drawn:
    """The renderer with its frames unpacked."""

    def __init__(self, footprint):
        self.made = plugins().build("renderer", Choice(name="points", options={"footprint": footprint}))

    def render(self, clouds, view, steps):
        return rig.render(self.made, Shot(view, tuple(clouds), steps))


def renderer(footprint=2):
    return Drawn(footprint)


def slow(clouds, view, steps, footprint):
    """One point, one pixel at a time; nothing shared with the kernel."""
    frames = np.zeros((steps, view.height, view.width), dtype=np.uint8)
    (fx, _, cx), (_, fy, cy), _ = view.intrinsics
    for n in range(steps):
        camera = view.transforms_world_to_camera
        camera = camera if camera.ndim == 2 else camera[n]
        for cloud in clouds:
            body = cloud.transforms_cloud_to_world
            body = body if body.ndim == 2 else body[n]
            for point in cloud.points:
                world = body[:3, :3] @ point + body[:3, 3]
                x, y, z = camera[:3, :3] @ world + camera[:3, 3]
                if z <= 0.01:
                    continue
                left = math.floor(fx * x / z + cx - footprint / 2 + 1)
                top = math.floor(fy * y / z + cy - footprint / 2 + 1)
                for row in range(top, top + footprint):
                    for column in range(left, left + footprint):
                        if 0 <= row < view.height and 0 <= column < view.width:
                            frames[n, row, column] = 255
    return frames


def random_transforms(rng, count, spread, away):
    rotations = Rotation.from_rotvec(rng.normal(scale=0.6, size=(count, 3))).as_matrix()
    return make_transform(rotations, rng.normal(scale=spread, size=(count, 3)) + np.array([0.0, 0.0, away]))


@pytest.mark.parametrize("seed", range(24))
def test_identical_to_the_slow_reference(seed):
    rng = np.random.default_rng(seed)
    height, width = [(24, 24), (17, 31), (40, 23), (96, 128)][seed % 4]
    footprint, steps = [1, 2, 3, 2, 5, 2][seed % 6], 5
    cameras = random_transforms(rng, steps, 0.3, 0.4)
    view = View(
        cameras if seed % 2 else cameras[0],
        pinhole_intrinsics(height, width, rng.uniform(30, 110)),
        height,
        width,
    )
    clouds = [
        Cloud("body", rng.normal(scale=0.5, size=(150, 3)), np.eye(4)),
        Cloud("body", rng.normal(scale=0.3, size=(80, 3)), random_transforms(rng, steps, 0.2, 0.0)),
    ]
    frames = renderer(footprint).render(clouds, view, steps)
    expected = slow(clouds, view, steps, footprint)
    assert frames.dtype == np.uint8
    assert 0.005 < np.mean(expected > 0) < 0.95, "the test must be able to fail"
    np.testing.assert_array_equal(frames, expected)


def lens(height=20, width=30):
    return View(np.eye(4), np.array([[10.0, 0.0, 14.5], [0.0, 10.0, 9.5], [0.0, 0.0, 1.0]]), height, width)


def lit(points, footprint=2, view=None):
    frame = renderer(footprint).render([Cloud("body", np.array(points), np.eye(4))], view or lens(), 1)[0]
    return {(int(row), int(column)) for row, column in np.argwhere(frame == 255)}


def test_a_point_on_the_axis_lights_the_four_middle_pixels():
    assert lit([[0.0, 0.0, 1.0]]) == {(9, 14), (9, 15), (10, 14), (10, 15)}


def test_points_behind_at_and_too_near_the_camera_are_dropped():
    assert lit([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.1, 0.1, 0.009], [0.0, 0.0, -1e-300]]) == set()


def test_points_far_outside_are_dropped_without_overflow():
    far = [[1e300, 0.0, 1.0], [-1e300, 0.0, 1.0], [0.0, 1e18, 0.02], [0.0, -1e18, 0.02], [1e5, 1e5, 1.0]]
    assert lit(far) == set()


@pytest.mark.parametrize("footprint", [1, 2, 3, 4])
def test_the_footprint_is_a_square_centred_on_the_point(footprint):
    rng = np.random.default_rng(footprint)
    for u, v in rng.uniform([8.0, 5.0], [20.0, 14.0], (40, 2)):
        pixels = np.array(sorted(lit([[(u - 14.5) / 10, (v - 9.5) / 10, 1.0]], footprint)))
        assert len(pixels) == footprint**2
        assert np.abs(pixels.mean(axis=0) - [v, u]).max() <= 0.5 + 1e-9


def test_the_footprint_is_cut_off_at_every_edge():
    corners = [(-0.9, -0.9), (-0.9, 29.5), (19.5, -0.9), (19.5, 29.5)]
    for v, u in corners:
        pixels = lit([[(u - 14.5) / 10, (v - 9.5) / 10, 1.0]])
        assert pixels == {(0 if v < 0 else 19, 0 if u < 0 else 29)}


def test_far_points_show_through_near_ones():
    near_and_far = lit([[0.0, 0.0, 1.0], [1.0, 0.0, 5.0]])
    assert near_and_far == lit([[0.0, 0.0, 1.0]]) | lit([[1.0, 0.0, 5.0]])
    assert lit([[0.0, 0.0, 1.0], [0.0, 0.0, 9.0]]) == lit([[0.0, 0.0, 1.0]])


def test_nothing_to_draw_is_black():
    assert not renderer().render([], lens(), 3).any()


def test_the_order_of_points_and_clouds_does_not_matter():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(300, 3)) + np.array([0.0, 0.0, 2.0])
    whole = renderer().render([Cloud("body", points, np.eye(4))], lens(), 2)
    parts = [
        Cloud("body", points[::-1][:100], np.eye(4)),
        Cloud("body", points[::-1][100:], np.eye(4)[None].repeat(2, 0)),
    ]
    np.testing.assert_array_equal(whole, renderer().render(parts, lens(), 2))


def test_axes_first_is_contiguous():
    points = np.random.default_rng(0).normal(size=(7, 3))
    np.testing.assert_array_equal(axes_first(points), points.T)
    assert axes_first(points).flags.c_contiguous


def test_listing_the_renderer_does_not_import_numba(run_python):
    run_python(
        "import sys; from geoprior.hooks.manager import plugins; plugins(); assert 'numba' not in sys.modules"
    )
