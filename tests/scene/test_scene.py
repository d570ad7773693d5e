"""Scenes over many seeds: what rests rests, what must be seen is seen."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from geoprior.errors import ConfigError
from geoprior.geometry.camera import CameraConfig, CamerasConfig
from geoprior.geometry.se3 import REFERENCE_QUATERNION, apply, invert
from geoprior.geometry.seeding import generator
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.scene.config import FloorConfig, HandConfig, SceneConfig, ThirdCameraConfig
from geoprior.scene.hand import cube_surface, hand_rotation
from geoprior.scene.scene import draw_scene

SEEDS = 210
PRIMITIVES = ("cone", "cylinder", "prism", "pyramid", "sphere", "truncated-cone", "truncated-pyramid")


@cache
def scenes(height=96, width=96):
    cameras = CamerasConfig(height=height, width=width)
    return [make(seed, cameras) for seed in range(SEEDS)]


def make(seed, cameras=None, config=None):
    rng = generator(seed, "test-scene")
    primitive = plugins().build("primitive", Choice(name=PRIMITIVES[seed % len(PRIMITIVES)]))
    return draw_scene(config or SceneConfig(), cameras or CamerasConfig(), primitive.sample(rng), rng)


def pixels_of(points, transform_camera_to_world, fov, height, width):
    """The pinhole equations once more, from the field of view."""
    local = (points - transform_camera_to_world[:3, 3]) @ transform_camera_to_world[:3, :3]
    focal = height / 2 / np.tan(np.radians(fov) / 2)
    columns = focal * local[:, 0] / local[:, 2] + width / 2 - 0.5
    rows = focal * local[:, 1] / local[:, 2] + height / 2 - 0.5
    return rows, columns, local[:, 2]


def assert_inside(points, transform_camera_to_world, fov, height, width):
    rows, columns, depth = pixels_of(points, transform_camera_to_world, fov, height, width)
    assert depth.min() > 0.0
    assert rows.min() >= 0
    assert rows.max() <= height - 1
    assert columns.min() >= 0
    assert columns.max() <= width - 1


def assert_first_frames(scene, size, hand_fov=75.0, third_fov=50.0):
    camera = scene.hand.transform_hand_to_world @ scene.hand.transform_camera_to_hand
    assert_inside(scene.object.vertices, camera, hand_fov, *size)
    camera = invert(scene.third_view.transforms_world_to_camera)
    cube = apply(scene.hand.transform_hand_to_world, scene.hand.points)
    assert_inside(np.vstack([scene.object.vertices, cube]), camera, third_fov, *size)


@pytest.mark.parametrize("size", [(96, 96), (128, 128), (480, 640)])
def test_the_hand_camera_sees_the_object_and_the_third_camera_object_and_hand(size):
    for scene in scenes(*size):
        assert_first_frames(scene, size)


@pytest.mark.parametrize("size", [(96, 96), (128, 64), (480, 640)])
def test_with_narrow_lenses_where_most_draws_fit_badly_too(size):
    """The default lenses are wide: the object is in view of nearly every hand, whatever is asked for."""
    lenses = {"hand": CameraConfig(vertical_fov=32.0), "third": CameraConfig(vertical_fov=36.0)}
    cameras = CamerasConfig(height=size[0], width=size[1], **lenses)
    config = SceneConfig(third=ThirdCameraConfig(distance=(0.9, 1.6)))
    for seed in range(70):
        assert_first_frames(make(seed, cameras, config), size, 32.0, 36.0)


@pytest.mark.slow
@pytest.mark.parametrize("size", [(96, 96), (128, 128), (480, 640)])
def test_first_frames_over_thousands_of_seeds(size):
    cameras = CamerasConfig(height=size[0], width=size[1])
    for seed in range(5000):
        assert_first_frames(make(seed, cameras), size)


def test_the_third_camera_looks_at_the_midpoint_from_above_the_floor():
    for scene in scenes():
        camera = invert(scene.third_view.transforms_world_to_camera)
        midpoint = 0.5 * (scene.object.centre + scene.hand.position)
        rows, columns, _ = pixels_of(midpoint[None], camera, 50.0, 96, 96)
        np.testing.assert_allclose([rows[0], columns[0]], [47.5, 47.5], atol=1e-6)
        assert camera[2, 3] > scene.floor.height + 0.1
        assert 0.6 - 1e-9 <= np.linalg.norm(camera[:3, 3] - midpoint) <= 1.3 + 1e-9
        assert camera[2, 1] < 0.0, "world up points up in the image"


def test_the_object_rests_on_the_floor_upright_and_within_reach():
    for scene in scenes():
        transform = scene.object.transform_object_to_world
        assert scene.object.vertices[:, 2].min() == pytest.approx(scene.floor.height, abs=1e-12)
        np.testing.assert_allclose(transform[:3, 2], [0.0, 0.0, 1.0], atol=1e-12)
        assert np.abs(scene.object.centre[:2]).max() <= 0.15
        assert np.abs(scene.object.vertices[:, :2]).max() <= 0.5 * scene.floor.side
        low, high = scene.object.mesh.vertices.min(axis=0), scene.object.mesh.vertices.max(axis=0)
        assert np.all(scene.object.points >= low - 1e-12)
        assert np.all(scene.object.points <= high + 1e-12)


def assert_uniform(values, low, high):
    """Uniform, all inside, and up to both ends."""
    assert kstest(values, "uniform", args=(low, high - low)).pvalue > 1e-3
    shares = (np.array(values) - low) / (high - low)
    assert 0.0 <= shares.min() < 0.03
    assert 0.97 < shares.max() <= 1.0


def test_place_and_yaw_of_the_object_are_uniform():
    places = np.array([[*scene.object.centre[:2], scene.object.yaw] for scene in scenes()])
    assert_uniform(places[:, 0], -0.15, 0.15)
    assert_uniform(places[:, 1], -0.15, 0.15)
    assert_uniform(places[:, 2], -np.pi, np.pi)
    assert np.abs(np.corrcoef(places.T)[np.triu_indices(3, 1)]).max() < 0.3
    for scene, (_, _, yaw) in zip(scenes(), places, strict=True):
        turn = Rotation.from_euler("z", yaw).as_matrix()
        np.testing.assert_allclose(scene.object.transform_object_to_world[:3, :3], turn, atol=1e-12)


def test_floors_vary_and_are_flat_grids_about_the_origin():
    for scene in scenes():
        floor = scene.floor
        assert np.all(floor.points[:, 2] == floor.height)
        line = np.unique(floor.points[:, 0])
        np.testing.assert_allclose(np.diff(line), floor.spacing, rtol=1e-9)
        assert len(floor.points) == len(line) ** 2
        assert floor.side - floor.spacing < np.ptp(line) <= floor.side
        np.testing.assert_allclose(floor.points.mean(axis=0)[:2], 0.0, atol=1e-12)
    assert_uniform([scene.floor.side for scene in scenes()], 0.6, 1.0)
    assert_uniform([scene.floor.height for scene in scenes()], -0.03, 0.03)
    assert_uniform([scene.floor.spacing for scene in scenes()], 0.05, 0.08)


def test_the_hand_starts_above_the_object_and_points_near_it():
    for scene in scenes():
        transform = scene.hand.transform_hand_to_world
        right, up, forward = transform[:3, :3].T
        np.testing.assert_allclose(np.cross(up, forward), right, atol=1e-12)
        np.testing.assert_allclose(transform[:3, :3].T @ transform[:3, :3], np.eye(3), atol=1e-12)
        height = scene.hand.position[2] - scene.floor.height
        assert 0.15 <= height <= 0.45
        assert scene.hand.position[2] >= scene.object.vertices[:, 2].max() + 0.05 - 1e-12
        reach = (scene.object.centre[2] - scene.hand.position[2]) / forward[2]
        meets = scene.hand.position + reach * forward
        assert np.linalg.norm(meets - scene.object.centre) <= 0.05 + 1e-9
        cube = apply(transform, scene.hand.points)
        assert np.all((cube - scene.hand.position) @ forward <= 1e-9), (
            "the cube lies behind the hand's origin"
        )


def test_start_quaternions_keep_to_the_hemisphere_of_the_reference():
    for scene in scenes():
        quaternion = Rotation.from_matrix(scene.hand.transform_hand_to_world[:3, :3]).as_quat()
        assert abs(quaternion @ REFERENCE_QUATERNION) > 0.3


def test_hand_rotation_is_straight_forward_along_the_heading():
    down = np.array([0.0, 0.0, -1.0])
    np.testing.assert_allclose(
        hand_rotation(down, 0.0), Rotation.from_quat(REFERENCE_QUATERNION).as_matrix(), atol=1e-12
    )
    for heading in np.linspace(-3.0, 3.0, 13):
        for tilt in (0.1, 0.8, 1.5):
            level = np.array([np.cos(heading), np.sin(heading), 0.0])
            forward = np.sin(tilt) * level + np.cos(tilt) * down
            up = np.array([0.0, 0.0, 1.0]) - forward[2] * forward
            np.testing.assert_allclose(
                hand_rotation(forward, heading)[:, 1], up / np.linalg.norm(up), atol=1e-9
            )


def test_hands_that_point_almost_alike_are_turned_almost_alike_near_straight_down():
    rng = np.random.default_rng(0)
    for _ in range(200):
        forward = np.array([*rng.normal(scale=1e-3, size=2), -1.0])
        turned = hand_rotation(forward / np.linalg.norm(forward), 0.3)
        straight = hand_rotation(np.array([0.0, 0.0, -1.0]), 0.3)
        assert Rotation.from_matrix(straight.T @ turned).magnitude() < 0.006


def test_the_camera_on_the_hand_looks_forward_from_behind():
    mount = scenes()[0].hand.transform_camera_to_hand
    np.testing.assert_allclose(mount[:3, 2], [0.0, 0.0, 1.0])
    np.testing.assert_allclose(mount[:3, 1], [0.0, -1.0, 0.0])
    np.testing.assert_allclose(mount[:3, 3], [0.0, 0.0, -0.1])


def test_cube_points_lie_on_the_cubes_surface():
    points = cube_surface(0.06, 6)
    assert len(points) == 6**3 - 4**3
    np.testing.assert_allclose(np.abs(points + np.array([0.0, 0.0, 0.03])).max(axis=1), 0.03, atol=1e-12)


def test_heading_spread_is_obeyed():
    config = SceneConfig(hand=HandConfig(heading_spread=0.0, offset=0.0, aim=0.0))
    for seed in range(20):
        scene = make(seed, config=config)
        np.testing.assert_allclose(scene.hand.transform_hand_to_world[:3, 1], [1.0, 0.0, 0.0], atol=1e-9)


def test_resolution_does_not_change_the_scene():
    for small, large in zip(
        scenes(96, 96)[:30], [make(s, CamerasConfig(height=480, width=480)) for s in range(30)], strict=True
    ):
        np.testing.assert_array_equal(small.object.points, large.object.points)
        np.testing.assert_array_equal(
            small.third_view.transforms_world_to_camera, large.third_view.transforms_world_to_camera
        )


@pytest.mark.parametrize(
    ("config", "cameras", "what"),
    [
        (SceneConfig(), CamerasConfig(hand=CameraConfig(vertical_fov=2.0)), "hand"),
        (SceneConfig(third=ThirdCameraConfig(distance=(0.05, 0.06))), CamerasConfig(), "third-person"),
    ],
)
def test_no_room_is_a_sentence_with_a_remedy(config, cameras, what):
    with pytest.raises(ConfigError, match=what) as fault:
        make(0, cameras, config)
    assert "fov" in fault.value.hint


def test_a_range_the_wrong_way_round_is_refused():
    with pytest.raises(ValueError, match=r"\[low, high\]"):
        FloorConfig(side=(1.0, 0.5))
