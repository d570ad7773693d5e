import json
import os
import re

import numpy as np
import pytest

from geoprior.errors import DataError
from geoprior.shards.archive import ArchiveWriter, read_members
from geoprior.shards.codec import encode_npy, encode_png
from geoprior.shards.manifest import MANIFEST, write_manifest
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.verify import info, verify
from geoprior.shards.writer import encode_episode, write_shard

KEY = "pick-000003"


def texts(path):
    return [str(fault) for fault in verify(path)]


def rewrite(folder, change):
    """Change the members of one sample and make the manifest fit, so that only the content is at fault."""
    path = folder / "a-000001.tar"
    data = path.read_bytes()
    samples = {}
    for member in read_members(path):
        key, _, suffix = member.name.partition(".")
        samples.setdefault(key, []).append((suffix, data[member.offset : member.offset + member.size]))
    samples[KEY] = change(samples[KEY])
    with path.open("wb") as file:
        archive = ArchiveWriter(file.write)
        for key, members in samples.items():
            for suffix, content in members:
                archive.add(f"{key}.{suffix}", content)
        archive.close()
    content = json.loads((folder / MANIFEST).read_text())
    content["shards"][1].update(json.loads(_record(path)))
    (folder / MANIFEST).write_text(json.dumps(content))


def _record(path):
    from geoprior.shards.manifest import record_of

    return record_of(path).model_dump_json()


def swap(suffix, content):
    return lambda members: [(name, content if name == suffix else old) for name, old in members]


def edit(suffix, change):
    return lambda members: [(name, change(old) if name == suffix else old) for name, old in members]


def poses(field, value):
    array = np.tile(np.array([0, 0, 0, 0, 0, 0, 1, 0], np.float32), (4, 1))
    array[2, field] = value
    return encode_npy(array)


def flip(data):
    return data[:-20] + bytes([data[-20] ^ 1]) + data[-19:]


FAULTS = {
    "a frame is missing": (
        lambda members: [m for m in members if m[0] != "hand.000002.png"],
        "members are missing: hand.000002.png",
    ),
    "a member is extra": (lambda members: [*members, ("a.txt", b"")], "members do not belong there: a.txt"),
    "a member is pickled": (
        lambda members: [*members, ("a.pyd", b"")],
        "pickled members are refused, for they can run code: a.pyd",
    ),
    "a member is repeated": (
        lambda members: [*members, members[-1]],
        "members occur more than once: third.000003.png",
    ),
    "the header is missing": (
        lambda members: [m for m in members if m[0] != "json"],
        "the header pick-000003.json is missing",
    ),
    "the header is cut off": (
        edit("json", lambda data: data[:50]),
        "pick-000003.json the whole: Invalid JSON",
    ),
    "the header is of another schema": (
        edit("json", lambda data: data.replace(b'"schema_version":1', b'"schema_version":2')),
        "pick-000003.json schema_version: Input should be 1",
    ),
    "the header has an unknown field": (
        edit("json", lambda data: data.replace(b'"seed":3', b'"seed":3,"more":1')),
        "pick-000003.json more: Extra inputs",
    ),
    "the header has another key": (
        edit("json", lambda data: data.replace(b"pick-000003", b"pick-000009")),
        "the header bears another key, 'pick-000009'",
    ),
    "the cameras are out of order": (
        edit("json", lambda data: data.replace(b'"name":"hand"', b'"name":"zzz"')),
        "the header's cameras ['zzz', 'third'] are not in alphabetical order",
    ),
    "a width is beyond all frames": (
        edit("json", lambda data: re.sub(rb'"width":\d+', b'"width":9999999999', data, count=1)),
        "pick-000003.json cameras.0.width: Input should be less than or equal to 65535",
    ),
    "a matrix has no rows": (
        edit("json", lambda data: re.sub(rb'"intrinsics":\[\[.*?\]\]', b'"intrinsics":[]', data, count=1)),
        "pick-000003.json cameras.0.intrinsics: List should have at least 3 items",
    ),
    "a pose is not finite": (swap("pose.npy", poses(0, np.nan)), "pose.npy: a value is not finite (step 2)"),
    "a quaternion is not of unit length": (
        swap("pose.npy", poses(6, 0.5)),
        "pose.npy: a quaternion is not of unit length (step 2)",
    ),
    "a quaternion changes sign": (
        swap("action.npy", poses(6, -1)),
        "action.npy: a quaternion changes sign to the next step (step 1)",
    ),
    "a gripper is between 0 and 1": (
        swap("pose.npy", poses(7, 0.5)),
        "pose.npy: a gripper is not 0 or 1 (step 2)",
    ),
    "there are too few poses": (
        swap("pose.npy", encode_npy(np.zeros((3, 8), np.float32))),
        "pose.npy: expected float32 (4, 8), found float32 (3, 8)",
    ),
    "a pose file is no array": (swap("pose.npy", b"hello"), "pick-000003.pose.npy"),
    "a frame is damaged": (
        edit("hand.000001.png", flip),
        "pick-000003.hand.000001.png is a damaged PNG: a checksum fails",
    ),
    "a frame is cut off": (
        edit("hand.000001.png", lambda data: data[:-3]),
        "pick-000003.hand.000001.png is a PNG that was cut off",
    ),
    "a frame is no image": (swap("hand.000001.png", b"hello"), "pick-000003.hand.000001.png is not a PNG"),
    "a frame is of another size": (
        swap("hand.000001.png", encode_png(np.zeros((10, 13), np.uint8))),
        "pick-000003.hand.000001.png is 10 x 13 pixels, not 10 x 12",
    ),
    "a binary frame is in colour": (
        swap("hand.000001.png", encode_png(np.zeros((10, 12, 3), np.uint8))),
        "pick-000003.hand.000001.png has 3 channels",
    ),
    "a colour frame is binary": (
        swap("third.000001.png", encode_png(np.zeros((10, 12), np.uint8))),
        "pick-000003.third.000001.png has 1 channels",
    ),
    "a binary frame has grey levels": (
        lambda members: swap("hand.000001.png", _grey())(members),
        "pick-000003.hand.000001.png is not binary",
    ),
}


def _grey():
    import cv2

    return cv2.imencode(".png", np.full((10, 12), 77, np.uint8))[1].tobytes()


def test_a_whole_data_set_has_no_faults(make_folder):
    folder = make_folder()
    assert texts(folder) == []
    assert texts(folder / "a-000000.tar") == []


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_of_a_sample_is_found_and_named(make_folder, name):
    change, text = FAULTS[name]
    folder = make_folder()
    rewrite(folder, change)
    path = folder / "a-000001.tar"
    for source in (folder, path):
        found = texts(source)
        assert any(fault.startswith(f"{path}: {KEY}: {text}") for fault in found), found
        assert all(fault.startswith(f"{path}: {KEY}: ") for fault in found), found


def test_the_faults_of_a_sample_read_differently():
    expected = [text for _, text in FAULTS.values()]
    assert len(set(expected)) == len(expected)


def test_several_faults_are_all_found(make_folder):
    folder = make_folder()
    rewrite(
        folder, lambda members: FAULTS["a frame is damaged"][0](FAULTS["a pose is not finite"][0](members))
    )
    assert len(texts(folder)) == 2


def shard(folder, number=1):
    return folder / f"a-{number:06d}.tar"


def flip_byte(folder):
    member = next(m for m in read_members(shard(folder)) if m.name == f"{KEY}.hand.000000.png")
    data = bytearray(shard(folder).read_bytes())
    data[member.offset + 30] ^= 8
    shard(folder).write_bytes(data)


def flip_padding(folder):
    data = bytearray(shard(folder).read_bytes())
    data[-1] ^= 1
    shard(folder).write_bytes(data)


def cut_between_members(folder):
    os.truncate(shard(folder), read_members(shard(folder))[-3].offset - 512)


def change_manifest(change):
    def damage(folder):
        content = json.loads((folder / MANIFEST).read_text())
        change(content["shards"])
        (folder / MANIFEST).write_text(json.dumps(content))

    return damage


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (lambda folder: (folder / MANIFEST).unlink(), [r"manifest.json: no such file"]),
        (lambda folder: (folder / MANIFEST).write_text("{"), ["manifest.json: not readable as JSON"]),
        (lambda folder: shard(folder).unlink(), ["a-000001.tar: no such file"]),
        (flip_byte, ["a-000001.tar: its SHA-256 is", "pick-000003.hand.000000.png is a damaged PNG"]),
        (flip_padding, ["a-000001.tar: its SHA-256 is"]),
        (
            cut_between_members,
            ["a-000001.tar: cut off: ", "a-000001.tar: its SHA-256 is", "a-000001.tar: cut off after byte"],
        ),
        (
            lambda folder: os.truncate(shard(folder), 3000),
            ["a-000001.tar: cut off: 3000 bytes", "its SHA-256 is", "a-000001.tar: cut off in pick-000003."],
        ),
        (
            lambda folder: (folder / "b.tar").write_bytes(shard(folder).read_bytes()),
            ["b.tar: is not listed in the manifest"],
        ),
        (
            change_manifest(lambda shards: shards[1]["samples"].append("more")),
            ["a-000001.tar: more: the manifest lists it, the shard lacks it"],
        ),
        (
            change_manifest(lambda shards: shards[1]["samples"].remove("pick-000003")),
            ["a-000001.tar: pick-000003: the shard holds it, the manifest does not list it"],
        ),
        (
            change_manifest(lambda shards: shards[1]["samples"].reverse()),
            ["a-000001.tar: its samples are in another order than the manifest says"],
        ),
    ],
)
def test_each_fault_of_a_file_is_found_and_named(make_folder, damage, expected):
    folder = make_folder()
    damage(folder)
    found = texts(folder)
    assert len(found) == len(expected), found
    for text, fault in zip(expected, found, strict=True):
        assert text in fault


def test_a_sample_in_two_places_is_found(tmp_path, make_episode):
    members = {i: sorted(encode_episode(make_episode(i))) for i in (0, 1)}
    with (tmp_path / "a.tar").open("wb") as file:
        archive = ArchiveWriter(file.write)
        for i in (0, 1, 0):
            for suffix, content in members[i]:
                archive.add(f"pick-{i:06d}.{suffix}", content)
        archive.close()
    assert texts(tmp_path / "a.tar") == [
        f"{tmp_path / 'a.tar'}: pick-000000: its members lie in 2 separate places"
    ]


def test_episodes_that_disagree_are_found(tmp_path, make_episode):
    records = [
        write_shard(tmp_path / "a.tar", [make_episode(0)]),
        write_shard(tmp_path / "b.tar", [make_episode(1, fps=20.0)]),
    ]
    write_manifest(tmp_path, records)
    (fault,) = texts(tmp_path)
    assert "pick-000000 and pick-000001 disagree on fps: 10.0 and 20.0" in fault


def test_an_empty_tar_and_a_file_that_is_none_are_found(tmp_path):
    (tmp_path / "a.tar").write_bytes(bytes(10240))
    assert texts(tmp_path / "a.tar") == [f"{tmp_path / 'a.tar'}: holds no samples"]
    (tmp_path / "b.tar").write_bytes(b"hello" * 1000)
    (fault,) = texts(tmp_path / "b.tar")
    assert "not a tar" in fault


def test_what_is_no_folder_of_shards_is_not_called_damaged(tmp_path, make_episode):
    with pytest.raises(DataError, match="no such file"):
        texts(tmp_path / "nowhere")
    below = tmp_path / "run" / "shards" / "demos"
    below.mkdir(parents=True)
    record = write_shard(below / "a.tar", [make_episode(0)])
    write_manifest(below, [record])
    with pytest.raises(DataError, match="no such file") as caught:
        texts(tmp_path / "run")
    assert str(below) in caught.value.hint


def test_shards_without_a_manifest_are_a_fault(tmp_path, make_episode):
    write_shard(tmp_path / "a.tar", [make_episode(0)])
    (fault,) = texts(tmp_path)
    assert "no such file" in fault


def test_info_counts_what_is_there(tmp_path, make_episode):
    episodes = [make_episode(0), make_episode(1, motion="push", steps=6), make_episode(2, motion="push")]
    record = write_shard(tmp_path / "a.tar", episodes)
    write_manifest(tmp_path, [record])
    found = info(tmp_path)
    assert json.loads(json.dumps(found)) == found
    assert found == {
        "path": str(tmp_path),
        "shards": 1,
        "episodes": 3,
        "steps": 14,
        "bytes": record.bytes,
        "fps": 10.0,
        "hands": ["hand"],
        "cameras": {"hand": [10, 12, 1], "third": [10, 12, 3]},
        "frames": {"hand": "binary", "third": "rgb"},
        "motions": {"pick": 1, "push": 2},
        "sources": {"synthetic": 3},
        "targets": [],
        "generators": {"test": 3},
        "digest": EpisodeStore(tmp_path).digest,
    }
    assert info(tmp_path / "a.tar") == found | {"path": str(tmp_path / "a.tar")}
