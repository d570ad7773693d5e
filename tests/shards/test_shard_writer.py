import dataclasses
import gc
import hashlib
import json
import tarfile
import weakref

import numpy as np
import pytest

from geoprior.errors import DataError
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.writer import write_shard


def test_the_record_tells_the_files_length_hash_and_keys(tmp_path, make_episode):
    path = tmp_path / "a.tar"
    record = write_shard(path, [make_episode(1), make_episode(0)])
    data = path.read_bytes()
    assert record.file == "a.tar"
    assert record.bytes == len(data)
    assert record.sha256 == hashlib.sha256(data).hexdigest()
    assert record.samples == ["pick-000001", "pick-000000"]


def test_the_same_episodes_give_the_same_bytes(tmp_path, make_episode):
    files = [tmp_path / "a.tar", tmp_path / "deeper" / "b.tar"]
    write_shard(files[0], [make_episode(i) for i in range(3)])
    write_shard(files[1], (make_episode(i) for i in range(3)))
    assert files[0].read_bytes() == files[1].read_bytes()
    write_shard(files[1], [make_episode(i) for i in (0, 1, 3)])
    assert files[0].read_bytes() != files[1].read_bytes()


def test_a_sample_has_the_promised_members_and_no_trace_of_time_or_user(tmp_path, make_episode):
    write_shard(tmp_path / "a.tar", [make_episode(steps=2)])
    with tarfile.open(tmp_path / "a.tar") as archive:
        infos = archive.getmembers()
        header = json.load(archive.extractfile("pick-000000.json"))
    frames = [f"{camera}.{step:06d}.png" for camera in ("hand", "third") for step in range(2)]
    assert [info.name for info in infos] == [
        f"pick-000000.{suffix}" for suffix in sorted(["json", "pose.npy", "action.npy", *frames])
    ]
    assert {(info.mtime, info.uid, info.gid, info.uname, info.gname, info.mode) for info in infos} == {
        (0, 0, 0, "geoprior", "geoprior", 0o444)
    }
    assert header["steps"] == 2


def test_one_episode_at_a_time_is_held(tmp_path, make_episode):
    made = []

    def episodes():
        for i in range(3):
            gc.collect()
            assert all(reference() is None for reference in made), "an earlier episode is still held"
            episode = make_episode(i)
            made.append(weakref.ref(episode.images["hand"]))
            yield episode
            del episode

    write_shard(tmp_path / "a.tar", episodes())
    assert len(made) == 3


def test_a_failure_half_way_leaves_what_was_there(tmp_path, make_episode):
    path = tmp_path / "a.tar"
    write_shard(path, [make_episode(0)])
    before = path.read_bytes()

    def episodes():
        yield make_episode(1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_shard(path, episodes())
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def spoil(episode, field, place, value):
    array = getattr(episode, field).copy()
    array[place] = value
    return dataclasses.replace(episode, **{field: array})


def spoil_image(episode, camera, image):
    return dataclasses.replace(episode, images={**episode.images, camera: image})


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda e: spoil(e, "pose", (2, 0), np.nan), r"pick-000000\.pose: a value is not finite \(step 2\)"),
        (lambda e: spoil(e, "action", (1, 7), 0.5), r"action: a gripper is not 0 or 1 \(step 1\)"),
        (
            lambda e: spoil(e, "pose", (1, slice(3, 7)), 0),
            r"pose: a quaternion is not of unit length \(step 1\)",
        ),
        (
            lambda e: spoil_image(e, "hand", e.images["hand"] // 2),
            r"pick-000000\.hand: step 0 holds the value 127",
        ),
        (lambda e: spoil_image(e, "third", e.images["hand"]), r"pick-000000\.third: expected uint8"),
        (lambda e: spoil_image(e, "other", e.images["hand"]), "cameras .* do not match images"),
        (
            lambda e: dataclasses.replace(e, header=e.header.model_copy(update={"details": {"a": np.inf}})),
            "pick-000000: the header cannot be written as JSON",
        ),
        (
            lambda e: dataclasses.replace(e, header=e.header.model_copy(update={"key": "k" * 90})),
            "longer than 100",
        ),
    ],
)
def test_an_episode_that_breaks_the_contract_is_named_and_nothing_is_written(
    tmp_path, make_episode, change, fault
):
    with pytest.raises(DataError, match=fault):
        write_shard(tmp_path / "a.tar", [make_episode(1), change(make_episode(0))])
    assert list(tmp_path.iterdir()) == []


def test_two_episodes_of_one_key_and_none_at_all_are_refused(tmp_path, make_episode):
    with pytest.raises(DataError, match="two episodes have the key 'pick-000000'"):
        write_shard(tmp_path / "a.tar", [make_episode(), make_episode()])
    with pytest.raises(DataError, match="no episodes"):
        write_shard(tmp_path / "a.tar", [])
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_named(tmp_path, make_episode):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DataError, match="cannot be written"):
        write_shard(tmp_path / "file" / "a.tar", [make_episode()])


def test_repeated_camera_names_are_refused(tmp_path, make_episode):
    episode = make_episode()
    twice = episode.header.model_copy(update={"cameras": [episode.header.cameras[0]] * 2})
    with pytest.raises(DataError, match="cameras"):
        write_shard(tmp_path / "a.tar", [dataclasses.replace(episode, header=twice)])


def test_a_shard_is_read_back_through_its_path_alone(tmp_path, make_episode, same):
    write_shard(tmp_path / "a.tar", [make_episode(5)])
    same(EpisodeStore(tmp_path / "a.tar").episode(0), make_episode(5))
