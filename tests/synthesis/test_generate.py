"""The stage: the same bytes however it is run, and it goes on where it was."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest
from pydantic import ValidationError

from geoprior.errors import ConfigError, DataError
from geoprior.executors.local import LocalConfig, LocalExecutor, SerialExecutor
from geoprior.files import sha256_file
from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice
from geoprior.shards.manifest import read_manifest
from geoprior.shards.reader import EpisodeStore
from geoprior.synthesis import generate as stage
from geoprior.synthesis import studio as synthesis
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import synthesise

CAMERAS = CamerasConfig(height=32, width=48)
CONFIG = GenerateConfig(fps=4, seconds=2, episodes=5, episodes_per_shard=6)


def run(out, config=CONFIG, executor=None, seed=3):
    return stage.generate(config, CAMERAS, seed=seed, executor=executor or SerialExecutor(), out=out)


def hashes(folder):
    return {path.name: sha256_file(path) for path in folder.iterdir()}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    run(folder)
    return folder


def test_the_data_set_is_what_the_config_says(made):
    manifest = read_manifest(made)
    assert [record.file for record in manifest.shards] == [f"synthetic-{i:06d}.tar" for i in range(3)]
    assert [len(record.samples) for record in manifest.shards] == [6, 6, 3]
    expected = {f"{motion}-{i:06d}" for motion in ("pick", "place", "push") for i in range(5)}
    assert set(manifest.keys) == expected
    for record in manifest.shards:
        assert {key.split("-")[0] for key in record.samples} == {"pick", "place", "push"}


def test_an_episode_is_the_same_alone_as_in_the_data_set(made):
    store = EpisodeStore(made)
    for number, key in enumerate(store.keys):
        motion, index = key.split("-")
        alone = synthesise(CONFIG, CAMERAS, 3, Choice(name=motion), int(index))
        stored = store.episode(number)
        alone.validate()
        assert stored.header == alone.header
        np.testing.assert_array_equal(stored.pose, alone.pose)
        np.testing.assert_array_equal(stored.action, alone.action)
        for camera in ("hand", "third"):
            np.testing.assert_array_equal(stored.images[camera], alone.images[camera])


def test_an_episode_does_not_depend_on_how_many_others_there_are():
    more = CONFIG.model_copy(update={"episodes": 500, "episodes_per_shard": 2, "motions": CONFIG.motions[:1]})
    one = synthesise(CONFIG, CAMERAS, 3, Choice(name="pick"), 4)
    other = synthesise(more, CAMERAS, 3, Choice(name="pick"), 4)
    assert one.header == other.header
    np.testing.assert_array_equal(one.images["third"], other.images["third"])


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_any_number_of_workers_writes_the_same_bytes(made, tmp_path, workers):
    run(tmp_path, executor=LocalExecutor(LocalConfig(workers=workers)))
    assert hashes(tmp_path) == hashes(made)


def test_the_order_of_completion_does_not_matter(made, tmp_path):
    class Backwards:
        def run(self, function, items):
            for position in reversed(range(len(items))):
                yield position, function(items[position])

    run(tmp_path, executor=Backwards())
    assert hashes(tmp_path) == hashes(made)


def test_another_seed_gives_other_episodes(made, tmp_path):
    run(tmp_path, config=CONFIG.model_copy(update={"episodes": 1}), seed=4)
    one, other = EpisodeStore(tmp_path).pose(0), EpisodeStore(made).pose(0)
    assert not np.array_equal(one, other)


def test_it_goes_on_where_it_was_and_makes_nothing_twice(made, tmp_path, monkeypatch):
    calls = []
    write = stage.write_samples

    def dying(path, episodes):
        calls.append(path.name)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return write(path, episodes)

    monkeypatch.setattr(stage, "write_samples", dying)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path)
    assert not (tmp_path / "manifest.json").exists(), "the manifest comes last"
    run(tmp_path)
    assert [int(name[10:16]) for name in calls] == [0, 1, 1, 2]
    assert hashes(tmp_path) == hashes(made)
    run(tmp_path)
    assert len(calls) == 4


@pytest.mark.parametrize("change", [{"fps": 5.0}, {"episodes_per_shard": 4}])
def test_shards_of_another_config_are_refused(made, tmp_path, change):
    path = tmp_path / "synthetic-000000.tar"
    path.write_bytes((made / path.name).read_bytes())
    with pytest.raises(DataError, match=r"synthetic-000000\.tar.*another config"):
        run(tmp_path, config=CONFIG.model_copy(update=change))
    with pytest.raises(DataError, match="another config"):
        run(tmp_path, seed=9)


def test_a_shard_of_which_one_motion_would_be_made_otherwise_is_refused(made, tmp_path):
    path = tmp_path / "synthetic-000000.tar"
    path.write_bytes((made / path.name).read_bytes())
    *others, _ = CONFIG.motions
    motions = [*others, Choice(name="push", options={"gap": [0.011, 0.012]})]
    with pytest.raises(DataError, match="another config"):
        run(tmp_path, config=CONFIG.model_copy(update={"motions": motions}))


def test_another_version_of_geoprior_goes_on_with_the_same_shards(made, tmp_path, monkeypatch):
    path = tmp_path / "synthetic-000000.tar"
    path.write_bytes((made / path.name).read_bytes())
    monkeypatch.setattr(synthesis, "__version__", "9.9")
    run(tmp_path)
    assert path.read_bytes() == (made / path.name).read_bytes()
    monkeypatch.setattr(synthesis, "REVISION", synthesis.REVISION + 1)
    with pytest.raises(DataError, match="another config"):
        run(tmp_path)


def test_a_damaged_shard_is_refused(made, tmp_path):
    path = tmp_path / "synthetic-000000.tar"
    path.write_bytes((made / path.name).read_bytes()[:5000])
    with pytest.raises(DataError, match=r"synthetic-000000\.tar"):
        run(tmp_path)


def test_pose_action_and_header_keep_the_contract(made):
    store = EpisodeStore(made)
    for number in range(len(store)):
        header, pose, action = store.header(number), store.pose(number), store.action(number)
        np.testing.assert_array_equal(action[:-1], pose[1:])
        np.testing.assert_array_equal(action[-1], pose[-1])
        assert header.steps == len(pose) == 8
        assert header.fps == 4
        assert header.source == "synthetic"
        assert (header.seed, header.hands) == (3, ["hand"])
        assert [(camera.name, camera.mount, camera.channels) for camera in header.cameras] == [
            ("hand", "hand", 1),
            ("third", "world", 1),
        ]
        details = json.loads(json.dumps(header.details, allow_nan=False))
        assert details["primitive"]["name"]
        assert sum(count for _, count in details["phases"]) == 8
        assert details["marker"] == (header.motion != "pick")


def test_every_primitive_is_drawn_about_as_often():
    from geoprior.synthesis.studio import stage_episode

    names = Counter(
        stage_episode(CONFIG, CAMERAS, 0, Choice(name="pick"), index).primitive.name for index in range(210)
    )
    assert len(names) == 7
    assert min(names.values()) > 12


def test_a_primitive_named_twice_is_two_choices():
    config = GenerateConfig(
        fps=4,
        seconds=1,
        primitives=[
            Choice(name="sphere", options={"diameter": [0.02, 0.02], "stretched": 0.0}),
            Choice(name="sphere", options={"diameter": [0.1, 0.1], "stretched": 0.0}),
        ],
    )
    sizes = {
        round(
            synthesise(config, CAMERAS, 0, Choice(name="pick"), i).header.details["object"]["extents"][2], 2
        )
        for i in range(12)
    }
    assert sizes == {0.02, 0.1}


def test_duplicate_motions_are_refused():
    with pytest.raises(ValidationError, match="pick named twice"):
        GenerateConfig(motions=[Choice(name="pick"), Choice(name="pick", options={"closed": 3})])


def test_no_steps_are_refused():
    with pytest.raises(ValidationError, match="two at least"):
        GenerateConfig(fps=1, seconds=1)


def test_unknown_names_are_errors_with_the_choices(tmp_path):
    for config in (
        CONFIG.model_copy(update={"motions": [Choice(name="pik")]}),
        CONFIG.model_copy(update={"primitives": [Choice(name="spere")]}),
        CONFIG.model_copy(update={"renderer": Choice(name="pints")}),
    ):
        with pytest.raises(ConfigError, match="unknown") as fault:
            run(tmp_path, config=config)
        assert "did you mean" in fault.value.hint
    assert not list(tmp_path.iterdir())


def test_the_config_is_light(run_python):
    run_python(
        "import sys; import geoprior.synthesis.config; "
        "heavy = {'scipy', 'numba', 'cv2', 'torch'} & set(sys.modules); assert not heavy, heavy"
    )
