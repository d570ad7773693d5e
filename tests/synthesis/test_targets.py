"""Targets: what they say is what the cameras and hands see, and they go through shards as they are."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geoprior.episode import HAND_AXES, validate_targets
from geoprior.errors import DataError
from geoprior.executors.local import SerialExecutor
from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.projection import project
from geoprior.geometry.se3 import apply
from geoprior.options import Choice, recipe_tree
from geoprior.shards.codec import encode_header, encode_npy
from geoprior.shards.manifest import write_manifest
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.stream import iterate
from geoprior.shards.verify import verify
from geoprior.shards.writer import encode_episode, write_shard
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.generate import generate
from geoprior.synthesis.studio import Studio
from geoprior.synthesis.targets import compute_targets, target_names

CAMERAS = CamerasConfig(height=24, width=40)
MOTIONS = ("pick", "place", "push")
CONFIG = GenerateConfig(episodes=2, seconds=2, motions=list(MOTIONS), targets=True)


def take_and_targets(motion, index=0):
    studio = Studio(CONFIG, CAMERAS, 5)
    take = studio.stage(Choice(name=motion), index)
    names = target_names(tuple(take.trajectory.hands), tuple(take.shots))
    return take, dict(zip(names, compute_targets(take.trajectory, take.shots).T, strict=True))


def centres(take):
    marker = take.trajectory.marker_points
    ways = take.trajectory.transforms_object_to_world[:, :3, 3]
    return {"object": ways} | ({} if marker is None else {"marker": np.tile(marker.mean(0), (len(ways), 1))})


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("camera", ["hand", "third"])
def test_an_image_target_is_where_the_camera_sees_the_point(motion, camera):
    take, targets = take_and_targets(motion)
    view = take.shots[camera].view
    for point, positions in centres(take).items():
        for step, position in enumerate(positions):
            transforms = view.transforms_world_to_camera
            transform = transforms[step] if transforms.ndim == 3 else transforms
            pixels, depth = project(position[None], transform, view.intrinsics)
            found = np.array([targets[f"{point}.{camera}.{axis}"][step] for axis in ("column", "row")])
            if depth[0] <= 0.01:
                assert np.isnan(found).all()
            else:
                edges = 0.5 * (found + 1.0) * [view.width, view.height] - 0.5
                np.testing.assert_allclose(edges, pixels[0], rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_hand_target_brought_back_to_the_world_is_the_point(motion):
    take, targets = take_and_targets(motion)
    for point, positions in centres(take).items():
        inside = np.stack([targets[f"{point}.hand.{axis}"] for axis in HAND_AXES], axis=-1)
        back = apply(take.trajectory.hand.transforms_hand_to_world, inside[:, None].astype(float))[:, 0]
        np.testing.assert_allclose(back, positions, atol=1e-6)


def test_the_whole_object_in_view_at_the_start_is_within_the_edges():
    for motion in MOTIONS:
        _, targets = take_and_targets(motion, 1)
        names = [f"object.{camera}.{axis}" for camera in ("hand", "third") for axis in ("column", "row")]
        starts = [targets[name][0] for name in names]
        assert np.abs(starts).max() < 1.0


def test_a_pick_has_no_marker_and_the_others_have():
    of_pick = take_and_targets("pick")[1]
    assert all(np.isnan(values).all() for name, values in of_pick.items() if name.startswith("marker"))
    for motion in ("place", "push"):
        marker = take_and_targets(motion)[1]["marker.hand.forward"]
        assert np.isfinite(marker).all()


def test_a_point_behind_a_camera_has_no_place_in_its_image():
    take, _ = take_and_targets("place")
    behind = take.trajectory.hand.transforms_hand_to_world.copy()
    behind[:, :3, 3] -= behind[:, :3, 2]
    targets = dict(
        zip(
            target_names(("hand",), ("hand", "third")),
            compute_targets(replace(take.trajectory, transforms_object_to_world=behind), take.shots).T,
            strict=True,
        )
    )
    assert np.isnan(targets["object.hand.column"]).all()
    np.testing.assert_allclose(targets["object.hand.forward"], -1.0, atol=1e-6)


def test_they_go_through_shards_as_they_are(tmp_path):
    generate(CONFIG, CAMERAS, seed=5, executor=SerialExecutor(), out=tmp_path)
    assert list(verify(tmp_path)) == []
    store = EpisodeStore(tmp_path)
    studio, streamed = Studio(CONFIG, CAMERAS, 5), list(iterate(tmp_path))
    assert store.target_names == target_names(("hand",), ("hand", "third"))
    assert len(store.target_names) == 14
    for place, key in enumerate(store.keys):
        motion, _, index = key.partition("-")
        expected = studio.episode(Choice(name=motion), int(index)).targets
        for found in (store.targets(place), store.episode(place).targets, streamed[place].targets):
            assert found.dtype == np.float32
            np.testing.assert_array_equal(found, expected)


def test_without_the_option_nothing_of_an_episode_is_another(tmp_path):
    plain = Studio(CONFIG.model_copy(update={"targets": False}), CAMERAS, 5).episode(Choice(name="push"), 1)
    named = Studio(CONFIG, CAMERAS, 5).episode(Choice(name="push"), 1)
    assert plain.targets is None
    assert "targets" not in json.loads(encode_header(plain.header))
    ours, theirs = dict(encode_episode(plain)), dict(encode_episode(named))
    assert theirs.keys() - ours.keys() == {"targets.npy"}
    assert all(theirs[name] == content for name, content in ours.items() if name != "json")
    assert "targets" not in recipe_tree(GenerateConfig())
    store = EpisodeStore(Path("shards/golden"))
    assert store.target_names == ()
    assert store.targets(0) is None


def with_targets(episode, targets, names=("a", "b")):
    header = episode.header.model_copy(update={"targets": list(names)})
    return replace(episode, header=header, targets=targets)


@pytest.mark.parametrize(
    ("targets", "message"),
    [
        (None, "expected float32 (4, 2), found none"),
        (np.zeros((4, 3), np.float32), "expected float32 (4, 2), found float32 (4, 3)"),
        (np.zeros((4, 2)), "expected float32 (4, 2), found float64 (4, 2)"),
        (np.array([[0, 0], [0, 0], [0, np.inf], [0, 0]], np.float32), "a value is infinite (step 2)"),
    ],
)
def test_what_does_not_fit_the_names_is_refused(make_episode, targets, message):
    episode = with_targets(make_episode(), targets)
    with pytest.raises(DataError) as error:
        episode.validate()
    assert error.value.message == f"pick-000000.targets: {message}"


def test_targets_without_names_are_refused(make_episode):
    header = make_episode().header
    with pytest.raises(DataError, match="expected float32"):
        validate_targets(header, np.zeros((4, 2), np.float32))


def test_unknown_numbers_are_allowed_and_a_damaged_member_is_named(make_episode, tmp_path, monkeypatch):
    unknown = np.full((4, 2), np.nan, np.float32)
    write_shard(tmp_path / "a.tar", [with_targets(make_episode(), unknown)])
    assert list(verify(tmp_path / "a.tar")) == []
    monkeypatch.setattr("geoprior.shards.writer.encode_npy", lambda array: encode_npy(array[:, :2]))
    named = with_targets(make_episode(), np.zeros((4, 3), np.float32), ("a", "b", "c"))
    write_shard(tmp_path / "b.tar", [named])
    (fault,) = [str(fault) for fault in verify(tmp_path / "b.tar") if "targets" in str(fault)]
    assert "expected float32 (4, 3), found float32 (4, 2)" in fault


def test_episodes_with_and_without_targets_do_not_mix(make_episode, tmp_path):
    mixed = [make_episode(0), with_targets(make_episode(1), np.zeros((4, 2), np.float32))]
    write_manifest(tmp_path, [write_shard(tmp_path / "a.tar", mixed)])
    with pytest.raises(DataError, match="disagree on targets"):
        EpisodeStore(tmp_path)
