"""Episodes of any number of hands: a motion's spec names them, and everything after follows."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from geoprior import MotionSpec, hookimpl
from geoprior.errors import ConfigError, PluginError
from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.projection import in_view
from geoprior.geometry.se3 import apply, invert, transforms_of_poses
from geoprior.hooks.manager import Plugins
from geoprior.motions.trajectory import HandWay, Trajectory
from geoprior.options import Choice, Options
from geoprior.scene.config import HandConfig, SceneConfig
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.writer import write_samples
from geoprior.sources._stager import Stager, StagerConfig
from geoprior.synthesis import studio as synthesis
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import Studio

HANDS = ("zoe", "ann", "mia")
"""Not in alphabetical order: that of the poses is the spec's, that of the cameras the alphabet's."""

CAMERAS = CamerasConfig(height=48, width=64)


class Waving:
    """Each hand rises at a speed of its own."""

    hands = HANDS

    def __init__(self, _config):
        pass

    def plan(self, scene, steps, rng):
        hands = {}
        for number, name in enumerate(self.hands):
            way = np.repeat(scene.hands[name].transform_hand_to_world[None], steps, axis=0)
            way[:, 2, 3] += 0.01 * (number + 1) * np.arange(steps)
            hands[name] = HandWay(way, np.full(steps, float(number == 1)))
        rest = np.repeat(scene.object.transform_object_to_world[None], steps, axis=0)
        return Trajectory(hands, rest, None, ("wave",) * steps)


class Forgetful(Waving):
    hands = HANDS[1:]


class Module:
    @hookimpl
    def geoprior_motions(self):
        yield MotionSpec("wave", "three hands", Options, Waving, hands=HANDS)
        yield MotionSpec("forget", "three hands, one forgotten", Options, Forgetful, hands=HANDS)
        for number, hands in enumerate([(), ("a", "a"), ("a", "third"), ("world",)]):
            yield MotionSpec(f"wrong-{number}", "no good names", Options, Waving, hands=hands)


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    found = Plugins()
    found.load_builtins()
    found.register(Module(), name="wave", package="tests", version="1")
    monkeypatch.setattr(synthesis, "plugins", lambda: found)


def config(*motions):
    return GenerateConfig(fps=6, seconds=1.0, motions=[Choice(name=name) for name in motions])


@pytest.fixture
def studio():
    return Studio(config("wave"), CAMERAS, 4)


def test_an_episode_of_three_hands_keeps_the_contract_and_comes_back_from_a_shard(studio, tmp_path):
    episode = studio.episode(Choice(name="wave"), 2)
    episode.validate()
    assert episode.pose.shape == episode.action.shape == (6, 24)
    assert episode.header.hands == list(HANDS)
    assert [(camera.name, camera.mount) for camera in episode.header.cameras] == [
        ("ann", "ann"), ("mia", "mia"), ("third", "world"), ("zoe", "zoe"),
    ]  # fmt: skip
    np.testing.assert_array_equal(episode.pose[:, 7::8], np.tile([0.0, 1.0, 0.0], (6, 1)))
    write_samples(tmp_path / "a.tar", [studio.sample(Choice(name="wave"), 2)])
    stored = EpisodeStore(tmp_path / "a.tar").episode(0)
    assert stored.header == episode.header
    np.testing.assert_array_equal(stored.pose, episode.pose)
    for name, frames in episode.images.items():
        np.testing.assert_array_equal(stored.images[name], frames)


def test_each_hand_is_a_way_of_its_own(studio):
    pose = studio.episode(Choice(name="wave"), 0).pose
    np.testing.assert_allclose(np.diff(pose[:, 2::8], axis=0), np.tile([0.01, 0.02, 0.03], (5, 1)), atol=1e-6)


def test_hands_share_the_circle_about_the_object(studio):
    sectors = []
    for index in range(30):
        scene = studio.stage(Choice(name="wave"), index).scene
        for number, hand in enumerate(scene.hands.values()):
            x, y, _ = hand.position - scene.object.centre
            turn = np.arctan2(y, x) % (2.0 * np.pi) / (2.0 * np.pi)
            assert number / 3 <= turn <= (number + 1) / 3
            sectors.append(3 * turn - number)
    assert min(sectors) < 0.2
    assert max(sectors) > 0.8


def test_cubes_are_of_one_size_and_apart_however_near_to_the_middle_they_start():
    scene = SceneConfig(hand=HandConfig(offset=0.06))
    crowded = Studio(config("wave").model_copy(update={"scene": scene}), CAMERAS, 4)
    for index in range(20):
        hands = list(crowded.stage(Choice(name="wave"), index).scene.hands.values())
        assert len({hand.cube for hand in hands}) == 1
        for hand, other in permutations(hands, 2):
            cube = apply(other.transform_hand_to_world, other.points)
            inside = apply(invert(hand.transform_hand_to_world), cube) / hand.cube + [0.0, 0.0, 0.5]
            assert np.abs(inside).max(axis=1).min() > 0.5


def test_the_first_frames_hold_the_object_and_the_third_every_cube(studio):
    for index in range(10):
        scene = studio.stage(Choice(name="wave"), index).scene
        for hand in scene.hands.values():
            assert in_view(hand.view, scene.object.vertices, 0.02)
            assert in_view(scene.third_view, apply(hand.transform_hand_to_world, hand.points), 0.02)


def test_a_hands_camera_shows_the_other_hands_and_not_its_own(studio):
    take = studio.stage(Choice(name="wave"), 1)
    for name in HANDS:
        shot = take.shots[name]
        cubes = [cloud.transforms_cloud_to_world for cloud in shot.clouds if cloud.body == "hand"]
        others = [take.trajectory.hands[other].transforms_hand_to_world for other in HANDS if other != name]
        assert len(cubes) == len(others)
        assert all(any(np.array_equal(cube, other) for cube in cubes) for other in others)
    assert sum(cloud.body == "hand" for cloud in take.shots["third"].clouds) == len(HANDS)


def test_the_header_says_where_each_camera_is(studio):
    episode, take = studio.episode(Choice(name="wave"), 3), studio.stage(Choice(name="wave"), 3)
    mounts = dict(zip(HANDS, transforms_of_poses(episode.pose.reshape(6, 3, 8)).swapaxes(0, 1), strict=True))
    for camera in episode.header.cameras:
        mount = mounts.get(camera.mount, np.broadcast_to(np.eye(4), (6, 4, 4)))
        told = invert(mount @ np.array(camera.transform_camera_to_mount))
        drawn = np.broadcast_to(take.shots[camera.name].view.transforms_world_to_camera, told.shape)
        np.testing.assert_allclose(told, drawn, atol=1e-5)


def test_the_endless_source_stages_the_same_episodes(studio):
    stager = Stager(StagerConfig(config("wave"), CAMERAS, 4, 2**20))
    episode = studio.episode(Choice(name="wave"), 0)
    assert stager.cameras() == tuple(sorted(episode.images))
    ((pose, action),) = stager.trajectories([0], [0])
    np.testing.assert_array_equal(pose, episode.pose)
    np.testing.assert_array_equal(action, episode.action)


def test_motions_of_different_hands_make_no_data_set():
    with pytest.raises(ConfigError, match=r"pick moves \['hand'\] and wave \['zoe', 'ann', 'mia'\]"):
        Studio(config("pick", "wave"), CAMERAS, 0)


@pytest.mark.parametrize("number", range(4))
def test_hands_that_cannot_be_told_apart_or_from_a_camera_are_refused(number):
    with pytest.raises(PluginError, match=f"wrong-{number}"):
        Studio(config(f"wrong-{number}"), CAMERAS, 0)


def test_a_motion_that_forgets_a_hand_is_named():
    studio = Studio(config("forget"), CAMERAS, 0)
    with pytest.raises(PluginError, match=r"'forget': planned ways for \['ann', 'mia'\]"):
        studio.stage(Choice(name="forget"), 0)
