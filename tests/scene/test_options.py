"""Options of scenes beyond the paper's: each does what it says, and a range that is none is refused."""

from __future__ import annotations

import numpy as np
import pytest

from geoprior.config import load_config
from geoprior.errors import ConfigError
from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.se3 import apply
from geoprior.geometry.seeding import child, generator
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.render import rig
from geoprior.render.variants.no_hand_cube import NoHandCube, NoHandCubeConfig
from geoprior.scene.config import (
    ArmConfig,
    DistractorsConfig,
    FingersConfig,
    HandConfig,
    SceneConfig,
    ThirdCameraConfig,
)
from geoprior.scene.mesh import bounds
from geoprior.scene.scene import draw_scene
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import Studio

CAMERAS = CamerasConfig(height=64, width=64)
COUNT = 60


def scenes(**config):
    solid = plugins().build("primitive", Choice(name="prism"))
    made = []
    for seed in range(COUNT):
        rng = generator(seed, "test-options")
        made.append(draw_scene(SceneConfig(**config), CAMERAS, solid.sample(rng), rng))
    return made


def hands(**options):
    return [scene.hand for scene in scenes(hand=HandConfig(**options))]


def staged(count=20, motion="pick", **scene):
    studio = Studio(GenerateConfig(seconds=3, scene=SceneConfig(**scene)), CAMERAS, 5)
    return [studio.stage(Choice(name=motion), index) for index in range(count)]


def test_a_child_generator_leaves_its_parent_alone_and_does_not_depend_on_it():
    parent, same = generator(1, "a"), generator(1, "a")
    before = child(parent, "x").random(3)
    parent.random(10)
    assert np.array_equal(child(parent, "x").random(3), before)
    assert not np.array_equal(child(parent, "y").random(3), before)
    assert not np.array_equal(child(generator(1, "b"), "x").random(3), before)
    same.random(10)
    assert parent.random() == same.random()


def test_what_today_draws_does_not_depend_on_the_new_options():
    """But for where the camera sits: it decides which starts have the object in view."""
    options = HandConfig(setback=(0.05, 0.1), fingers=FingersConfig())
    for old, new in zip(scenes(), scenes(hand=options, arm=ArmConfig()), strict=True):
        np.testing.assert_array_equal(old.hand.transform_hand_to_world, new.hand.transform_hand_to_world)
        np.testing.assert_array_equal(old.object.points, new.object.points)


def test_down_is_the_share_of_starts_that_point_straight_down():
    for share in (0.0, 0.5, 1.0):
        made = hands(down=share, down_tilt=2.0, aim=0.3)
        tilts = [np.degrees(np.arccos(-hand.transform_hand_to_world[2, 2])) for hand in made]
        assert np.mean(np.array(tilts) <= 2.0) == pytest.approx(share, abs=0.2)
    assert max(tilts) <= 2.0 + 1e-9
    assert max(tilts) > 1.5


def test_a_start_about_the_middle_does_not_follow_the_object():
    for about, least, most in (("object", 0.5, 1.0), ("middle", -0.3, 0.3)):
        made = scenes(hand=HandConfig(about=about, offset=0.1, aim=0.05, down=1.0))
        places = np.array([[scene.hand.position[0], scene.object.centre[0]] for scene in made])
        assert least < np.corrcoef(places.T)[0, 1] < most
    for scene in made:
        assert np.linalg.norm(scene.hand.position[:2]) <= 0.1


def test_the_camera_sits_where_the_ranges_say_and_is_pitched_towards_minus_up():
    made = hands(
        camera_right=(-0.02, 0.02),
        camera_up=(0.04, 0.08),
        camera_distance=(0.05, 0.15),
        camera_pitch=(10, 20),
    )
    mounts = np.stack([hand.transform_camera_to_hand for hand in made])
    for axis, (low, high) in enumerate([(-0.02, 0.02), (0.04, 0.08), (-0.15, -0.05)]):
        assert low <= mounts[:, axis, 3].min() < low + 0.2 * (high - low)
        assert high - 0.2 * (high - low) < mounts[:, axis, 3].max() <= high
    pitches = np.degrees(np.arctan2(-mounts[:, 1, 2], mounts[:, 2, 2]))
    assert 10.0 <= pitches.min() < pitches.max() <= 20.0
    np.testing.assert_allclose(mounts[:, 0, 2], 0.0, atol=1e-12)


def test_a_camera_in_the_hand_is_mounted_as_one_in_simulation():
    """With the numbers of the built-in arms, and with a pitch, whose sign the two must share."""
    pytest.importorskip("mujoco")
    from types import SimpleNamespace

    from geoprior.scene.hand import camera_mount
    from geoprior.sim.worlds.tabletop import Tabletop

    robot = SimpleNamespace(camera_position=(0.01, 0.06, -0.10), camera_pitch=0.3)
    world = SimpleNamespace(arms={"hand": SimpleNamespace(robot=robot)})
    expected = Tabletop.transform_camera_to_hand(world)
    np.testing.assert_allclose(camera_mount(0.01, 0.06, 0.10, 0.3), expected, atol=1e-12)


def test_the_cube_is_set_back_behind_the_origin():
    for hand in hands(setback=(0.05, 0.1)):
        assert 0.05 <= hand.setback <= 0.1
        assert hand.points[:, 2].max() == pytest.approx(-hand.setback)
        low, high = bounds(hand.solids(0.0)[0])
        np.testing.assert_allclose([low[2], high[2]], [-hand.setback - hand.cube, -hand.setback])


def test_both_lenses_are_off_by_up_to_what_is_said():
    made = scenes(hand=HandConfig(lens=5.0), third=ThirdCameraConfig(lens=4.0))
    for view, middle, off in (("hand", 75.0, 5.0), ("third", 50.0, 4.0)):
        views = [scene.hand.view if view == "hand" else scene.third_view for scene in made]
        fovs = np.array([2.0 * np.degrees(np.arctan(32.0 / each.intrinsics[0, 0])) for each in views])
        assert middle - off <= fovs.min() < middle - 0.5 * off
        assert middle + 0.5 * off < fovs.max() <= middle + off


def test_the_third_camera_looks_past_the_middle_by_up_to_its_target():
    misses = []
    for scene in scenes(third=ThirdCameraConfig(target=0.05)):
        middle = 0.5 * (scene.object.centre + scene.hand.position)
        x, y, depth = apply(scene.third_view.transforms_world_to_camera, middle[None])[0]
        misses.append(np.hypot(x, y))
        assert depth > 0.0
    assert 0.02 < max(misses) <= 0.05 * np.sqrt(3.0)


def test_two_fingers_are_seen_by_both_cameras_and_close_with_the_gripper():
    fingers = FingersConfig(opening=(0.1, 0.1), thickness=(0.01, 0.01), width=(0.02, 0.02), past=(0.01, 0.01))
    for take in staged(5, hand=HandConfig(setback=(0.08, 0.08), fingers=fingers)):
        seen = {name: [c for c in shot.clouds if c.body == "finger"] for name, shot in take.shots.items()}
        assert [len(found) for found in seen.values()] == [2, 2]
        way = take.trajectory.hand
        for cloud, side in zip(seen["third"], (1.0, -1.0), strict=True):
            local = np.linalg.inv(way.transforms_hand_to_world) @ cloud.transforms_cloud_to_world
            corners = apply(local, cloud.surface.vertices[None])
            inner = np.abs(corners[..., 0]).min(axis=1)
            np.testing.assert_allclose(inner, np.where(way.gripper == 0.0, 0.05, 0.0), atol=1e-12)
            assert np.all(side * corners[..., 0] >= -1e-12)
            np.testing.assert_allclose(corners[..., 2].max(), 0.01)
            np.testing.assert_allclose(corners[..., 2].min(), -0.08)
            low, high = bounds(cloud.surface)
            assert np.abs((cloud.points - low) * (cloud.points - high)).min(axis=1).max() < 1e-12


def test_the_arm_hangs_together_from_the_floor_to_the_hand_and_only_the_third_camera_sees_it():
    for take in staged(20, motion="place", arm=ArmConfig()):
        assert not any(cloud.body == "arm" for cloud in take.shots["hand"].clouds)
        column, wrist, upper, fore = (c for c in take.shots["third"].clouds if c.body == "arm")
        at = upper.transforms_cloud_to_world
        frames = at[:, :3, :3]
        identity = np.broadcast_to(np.eye(3), frames.shape)
        np.testing.assert_allclose(np.swapaxes(frames, 1, 2) @ frames, identity, atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(fore.transforms_cloud_to_world[:, :3, :3]), 1.0)
        top = column.transforms_cloud_to_world[:3, 3] + [0.0, 0.0, bounds(column.surface)[1][2]]
        np.testing.assert_allclose(at[:, :3, 3], np.broadcast_to(top, (len(at), 3)))
        np.testing.assert_allclose(end_of(upper), fore.transforms_cloud_to_world[:, :3, 3], atol=1e-9)
        back = np.array([[0.0, 0.0, bounds(wrist.surface)[0][2]]])
        np.testing.assert_allclose(end_of(fore), apply(wrist.transforms_cloud_to_world, back[None])[:, 0])
        assert column.transforms_cloud_to_world[0, 3] < -0.4, "it stands where robots stand"
        steps = np.linalg.norm(np.diff(fore.transforms_cloud_to_world[:, :3, 3], axis=0), axis=1)
        hand = take.trajectory.hand.transforms_hand_to_world[:, :3, 3]
        assert steps.max() < 5.0 * np.linalg.norm(np.diff(hand, axis=0), axis=1).max() + 0.02, (
            "no elbow jumps"
        )


def end_of(link):
    tip = np.array([[0.0, 0.0, bounds(link.surface)[1][2]]])
    return apply(link.transforms_cloud_to_world, tip[None])[:, 0]


def test_as_many_distractors_as_said_lie_on_the_floor_at_their_distance():
    counts = []
    for take in staged(40, distractors=DistractorsConfig(count=(1, 3), distance=(0.2, 0.4))):
        found = [cloud for cloud in take.shots["third"].clouds if cloud.body == "distractor"]
        counts.append(len(found))
        for cloud in found:
            world = apply(cloud.transforms_cloud_to_world, cloud.surface.vertices)
            assert world[:, 2].min() == pytest.approx(take.scene.floor.height)
            assert 0.2 <= np.linalg.norm(cloud.transforms_cloud_to_world[:2, 3]) <= 0.4
            assert any(cloud.points is each.points for each in take.shots["hand"].clouds)
    assert set(counts) >= {1, 2, 3}
    assert max(counts) == 3


def test_distractors_without_room_are_left_out():
    for take in staged(3, distractors=DistractorsConfig(count=(3, 3), distance=(0.1, 0.15), gap=0.5)):
        assert not take.scene.distractors


def test_without_the_hand_cube_neither_fingers_nor_arm_are_drawn():
    hand = HandConfig(setback=(0.08, 0.08), fingers=FingersConfig())
    (take,) = staged(1, hand=hand, arm=ArmConfig())
    left = NoHandCube(NoHandCubeConfig()).change(rig.shots(take.scene, take.trajectory))
    assert {cloud.body for shot in left.values() for cloud in shot.clouds} == {"floor", "object"}


RANGES = (
    *("hand.setback", "hand.camera_up", "hand.camera_right", "hand.camera_pitch", "hand.camera_distance"),
    *(f"arm.{name}" for name in ("distance", "bearing", "shoulder", "thickness", "wrist", "slack", "swivel")),
    *("distractors.count", "distractors.distance"),
)


@pytest.mark.parametrize("key", RANGES)
@pytest.mark.parametrize("value", ["[3, 2]", "[2]", "[1, 1.0e6]", "wide"])
def test_a_range_that_is_none_is_refused_with_its_key(key, value):
    with pytest.raises(ConfigError) as fault:
        load_config("lite", [f"generate.scene.{key}={value}"], plugins())
    assert f"generate.scene.{key}" in str(fault.value)


def test_fingers_need_room_and_the_sentence_says_where():
    with pytest.raises(ConfigError, match="fingers need a cube that is set back") as fault:
        load_config("lite", ["generate.scene.hand.fingers={}"], plugins())
    assert "generate.scene.hand" in str(fault.value)
    assert "raise setback" in str(fault.value)


def test_a_camera_mount_that_never_has_the_object_in_view_ends_with_a_remedy():
    with pytest.raises(ConfigError, match="has the object") as fault:
        hands(camera_pitch=(120.0, 130.0))
    assert "camera_pitch" in fault.value.hint
