from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geoprior.errors import ConfigError
from geoprior.executors.local import SerialExecutor
from geoprior.shards.reader import EpisodeStore
from geoprior.synthesis.generate import generate, plan_shards
from geoprior.view.subject import parse_episode, staged_subject, stored_subject, with_points


@pytest.fixture(scope="module")
def folder(studio, tmp_path_factory):
    """The whole small data set on a disk."""
    out = tmp_path_factory.mktemp("shards")
    generate(studio.config, studio.cameras, seed=studio.seed, executor=SerialExecutor(), out=out)
    return out


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("run/shards", ("run/shards", "0")),
        ("run/shards:pick-000003", ("run/shards", "pick-000003")),
        ("run/shards:3", ("run/shards", "3")),
        ("run/a.tar:pick-000003", ("run/a.tar", "pick-000003")),
        ("quickstart:push-000004", ("quickstart", "push-000004")),
        ("C:run:pick", ("C:run", "pick")),
        (":pick", (":pick", "0")),
    ],
)
def test_an_episode_is_a_source_and_perhaps_a_key(text, expected):
    assert parse_episode(text) == expected


def test_a_path_with_a_colon_that_exists_is_taken_whole(tmp_path):
    (tmp_path / "a:b").mkdir()
    assert parse_episode(f"{tmp_path}/a:b") == (f"{tmp_path}/a:b", "0")
    assert parse_episode(f"{tmp_path}/a:b:key") == (f"{tmp_path}/a:b", "key")


def test_an_episode_on_no_disk_is_the_one_that_would_be_written(studio, folder):
    store = EpisodeStore(folder)
    for key in ("pick-000000", "place-000002", "push-000001"):
        made, stored = staged_subject(studio, key).episode, store.episode(store.position(key))
        assert made.header == stored.header
        np.testing.assert_array_equal(made.pose, stored.pose)
        for name, frames in stored.images.items():
            np.testing.assert_array_equal(made.images[name], frames)


def test_numbers_count_as_in_the_data_set(studio):
    [plan] = plan_shards(studio.config, studio.cameras, studio.seed, Path())
    assert [staged_subject(studio, str(i)).episode.header.key for i in range(9)] == plan.keys


@pytest.mark.parametrize(
    "episode",
    ["shove-000000", "push", "push-", "push-0", "push-000003", "push-00000a", "push-0000000", "9", "-1", ""],
)
def test_an_episode_that_the_config_does_not_make_is_refused_with_those_that_it_makes(studio, episode):
    with pytest.raises(ConfigError, match=f"no episode '{episode}'") as caught:
        staged_subject(studio, episode)
    assert "9: pick-000000 to push-000002" in caught.value.hint


def test_the_nearest_motion_is_proposed(studio):
    with pytest.raises(ConfigError) as caught:
        staged_subject(studio, "pusch-000001")
    assert "did you mean push-000001?" in caught.value.hint


def test_points_are_made_again_where_the_recipe_is_the_same(studio, folder):
    stored = stored_subject(folder, "push-000001")
    assert stored.bodies is None
    again = with_points(stored, studio)
    assert again.remark == ""
    assert again.episode is stored.episode
    made = staged_subject(studio, "push-000001").bodies
    for ours, theirs in zip(again.bodies.clouds, made.clouds, strict=True):
        np.testing.assert_array_equal(ours.points, theirs.points)
        np.testing.assert_array_equal(ours.transforms_cloud_to_world, theirs.transforms_cloud_to_world)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        (["seed=77"], "another episode"),
        (["generate.scene.hand.aim=0.01"], "another episode"),
        (["generate.motions=[pick]"], "no motion 'push'"),
    ],
)
def test_points_are_not_made_up_where_the_recipe_is_another_one(folder, make_studio, settings, reason):
    subject = with_points(stored_subject(folder, "push-000001"), make_studio(*settings))
    assert subject.bodies is None
    assert subject.remark.startswith("push-000001: drawn without points")
    assert reason in subject.remark
    assert "\n" not in subject.remark


def test_the_version_that_made_it_is_named_when_it_is_another_one(folder, make_studio):
    stored = stored_subject(folder, "push-000001")
    header = stored.episode.header.model_copy(update={"generator": "geoprior 0.0.1"})
    old = replace(stored, episode=replace(stored.episode, header=header))
    assert "geoprior 0.0.1 made this one" in with_points(old, make_studio("seed=77")).remark
    assert "made this one" not in with_points(stored, make_studio("seed=77")).remark


def test_points_that_do_not_fit_the_poses_are_not_drawn(studio, folder):
    """A program that has changed under the same recipe."""
    stored = stored_subject(folder, "push-000001")
    moved = replace(stored.episode, pose=stored.episode.pose + np.float32(1e-3))
    subject = with_points(replace(stored, episode=moved), studio)
    assert subject.bodies is None
    assert "other poses" in subject.remark
