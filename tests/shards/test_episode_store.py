import json
import multiprocessing
import os
import pickle
import shutil
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from operator import methodcaller
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geoprior.errors import DataError
from geoprior.shards import spans
from geoprior.shards.archive import ArchiveWriter, read_members
from geoprior.shards.manifest import MANIFEST, write_manifest
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.writer import encode_episode, write_shard

SIDE = st.integers(1, 20)
CAMERAS = st.dictionaries(
    st.from_regex(r"[a-z0-9][a-z0-9_-]{0,9}", fullmatch=True),
    st.tuples(SIDE, SIDE, st.sampled_from([1, 3])),
    min_size=1,
    max_size=3,
).map(lambda cameras: tuple((name, *cameras[name]) for name in sorted(cameras)))


def write_members(path, *samples):
    """Write any members whatever; gives the shard's record by its content alone."""
    with path.open("wb") as file:
        archive = ArchiveWriter(file.write)
        for key, members in samples:
            for suffix, content in members:
                archive.add(f"{key}.{suffix}", content)
        archive.close()


@settings(max_examples=25, deadline=None)
@given(
    cameras=CAMERAS,
    steps=st.integers(1, 5),
    hands=st.sampled_from([("hand",), ("left", "right")]),
    fps=st.sampled_from([0.5, 10.0, 29.97]),
    count=st.integers(1, 3),
)
def test_episodes_of_any_layout_survive(
    tmp_path_factory, make_episode, same, cameras, steps, hands, fps, count
):
    folder = tmp_path_factory.mktemp("data")
    episodes = [make_episode(i, steps=steps, cameras=cameras, hands=hands, fps=fps) for i in range(count)]
    write_manifest(
        folder, [write_shard(folder / f"s-{i}.tar", [episode]) for i, episode in enumerate(episodes)]
    )
    store = EpisodeStore(folder)
    assert len(store) == count
    assert store.keys == tuple(episode.header.key for episode in episodes)
    assert store.cameras == tuple(name for name, *_ in cameras)
    assert (store.hands, store.fps) == (hands, fps)
    for i, episode in enumerate(episodes):
        same(store.episode(i), episode)
        store.episode(i).validate()
        assert store.header(i) == episode.header
        np.testing.assert_array_equal(store.pose(i), episode.pose)
        np.testing.assert_array_equal(store.action(i), episode.action)
    shutil.rmtree(folder)


@pytest.mark.parametrize("steps", [[0], [3, 0, 3], [], range(4), np.array([2, 1])])
def test_frames_come_in_the_order_asked_for(make_folder, make_episode, steps):
    store = EpisodeStore(make_folder())
    for i in (1, 4):
        for camera in ("hand", "third"):
            expected = make_episode(i).images[camera][np.asarray(steps, int)]
            np.testing.assert_array_equal(store.frames(i, camera, steps), expected)
            assert store.frames(i, camera, steps).dtype == np.uint8


def test_what_does_not_exist_is_named(make_folder):
    store = EpisodeStore(make_folder())
    for step in (-1, 4):
        with pytest.raises(IndexError, match=f"step {step} is not in 0 to 3"):
            store.frames(0, "hand", [step])
    with pytest.raises(DataError, match="no camera 'hnad'") as caught:
        store.frames(0, "hnad", [0])
    assert "hand, third" in caught.value.hint
    with pytest.raises(IndexError):
        store.pose(5)


def test_episodes_are_found_by_key_and_by_number(make_folder):
    store = EpisodeStore(make_folder())
    assert [store.position(key) for key in store.keys] == [0, 1, 2, 3, 4]
    assert [store.position(3), store.position("3")] == [3, 3]
    with pytest.raises(DataError, match="no episode 'pick-00003'") as caught:
        store.position("pick-00003")
    assert "did you mean 'pick-000003'" in caught.value.hint
    for number in (5, -1):
        with pytest.raises(DataError, match="no episode"):
            store.position(number)


def test_the_digest_is_the_contents_and_not_the_folders(make_folder):
    one, two = EpisodeStore(make_folder("one")), EpisodeStore(make_folder("two"))
    other = EpisodeStore(make_folder("other", fps=20.0))
    assert one.digest == two.digest != other.digest


def test_image_size_needs_cameras_of_one_size(make_folder):
    assert EpisodeStore(make_folder()).image_size == (10, 12)
    mixed = EpisodeStore(make_folder("mixed", cameras=(("a", 4, 6, 1), ("b", 4, 8, 1))))
    assert mixed.frame_shapes == {"a": (4, 6), "b": (4, 8)}
    with pytest.raises(DataError, match="differ in size"):
        _ = mixed.image_size


@pytest.mark.parametrize(
    ("layout", "field"),
    [
        ({"fps": 20.0}, "fps: 10.0 and 20.0"),
        ({"hands": ("left",)}, r"hands: \['hand'\] and \['left'\]"),
        ({"cameras": (("hand", 10, 12, 1),)}, "cameras"),
        ({"cameras": (("hand", 10, 13, 1), ("third", 10, 12, 3))}, "cameras"),
        ({"cameras": (("hand", 10, 12, 3), ("third", 10, 12, 3))}, "cameras"),
        (
            {"cameras": (("hand", 10, 12, "gray"), ("third", 10, 12, 3))},
            "cameras: .*'hand': 'binary 10 x 12'.* and .*'hand': 'gray 10 x 12'",
        ),
    ],
)
def test_episodes_that_disagree_are_both_named(tmp_path, make_episode, layout, field):
    episodes = [make_episode(0), make_episode(1), make_episode(2, **layout)]
    write_manifest(tmp_path, [write_shard(tmp_path / "a.tar", episodes)])
    with pytest.raises(DataError, match=rf"pick-000000 and pick-000002 disagree on {field}"):
        EpisodeStore(tmp_path)


def test_episodes_may_differ_in_length_and_motion(tmp_path, make_episode, same):
    episodes = [make_episode(0, steps=2), make_episode(1, steps=5, motion="push")]
    write_manifest(tmp_path, [write_shard(tmp_path / "a.tar", episodes)])
    store = EpisodeStore(tmp_path)
    for i, episode in enumerate(episodes):
        same(store.episode(i), episode)


def shard(folder):
    return folder / "a-000001.tar"


def cut_between_members(folder):
    member = read_members(shard(folder))[5]
    os.truncate(shard(folder), member.offset - 512)


@pytest.mark.parametrize(
    ("damage", "fault"),
    [
        (cut_between_members, r"a-000001\.tar: cut off: \d+ bytes, \d+ are expected"),
        (
            lambda folder: os.truncate(shard(folder), 5000),
            r"a-000001\.tar: cut off: 5000 bytes, \d+ are expected",
        ),
        (lambda folder: os.truncate(shard(folder), 0), r"a-000001\.tar: cut off: 0 bytes"),
        (lambda folder: os.truncate(shard(folder), 99_999), r"a-000001\.tar: too long"),
        (lambda folder: shard(folder).unlink(), r"a-000001\.tar: no such file, \d+ bytes are expected"),
        (lambda folder: (folder / MANIFEST).unlink(), r"manifest\.json: no such file"),
    ],
)
def test_a_shard_that_is_cut_off_or_missing_is_named_on_opening(make_folder, damage, fault):
    folder = make_folder()
    damage(folder)
    with pytest.raises(DataError, match=fault) as caught:
        EpisodeStore(folder)
    assert "geoprior generate" in caught.value.hint


def test_samples_other_than_the_manifests_are_refused(make_folder):
    folder = make_folder()
    content = json.loads((folder / MANIFEST).read_text())
    content["shards"][0]["samples"].reverse()
    (folder / MANIFEST).write_text(json.dumps(content))
    with pytest.raises(DataError, match=r"a-000000\.tar: holds other samples"):
        EpisodeStore(folder)


def members_of(episode):
    return sorted(encode_episode(episode))


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda members: [m for m in members if m[0] != "hand.000002.png"], r"missing: hand\.000002\.png"),
        (lambda members: [m for m in members if m[0] != "json"], "header pick-000000.json is missing"),
        (lambda members: [*members, ("label.cls", b"1")], r"do not belong there: label\.cls"),
        (
            lambda members: [*members, ("extra.pkl", b"\x80\x04N.")],
            r"pickled members are refused.*extra\.pkl",
        ),
        (lambda members: [*members, ("weights.pth", b"")], r"pickled members are refused.*weights\.pth"),
        (lambda members: [*members, members[0]], r"more than once: action\.npy"),
        (
            lambda members: [(s, b"{}" if s == "json" else c) for s, c in members],
            r"pick-000000\.json key: Field required",
        ),
        (
            lambda members: [
                (s, c.replace(b'"steps":4', b'"steps":400000000') if s == "json" else c) for s, c in members
            ],
            "promises 400000000 steps",
        ),
    ],
)
def test_samples_that_are_not_whole_are_refused_on_opening(tmp_path, make_episode, change, fault):
    write_members(tmp_path / "a.tar", ("pick-000000", change(members_of(make_episode()))))
    with pytest.raises(DataError, match=fault):
        EpisodeStore(tmp_path / "a.tar")


def test_a_sample_under_another_key_is_refused(tmp_path, make_episode):
    write_members(tmp_path / "a.tar", ("other", members_of(make_episode())))
    with pytest.raises(DataError, match=r"other: the header bears another key, 'pick-000000'"):
        EpisodeStore(tmp_path / "a.tar")


def test_a_damaged_frame_is_named_when_it_is_read(make_folder):
    folder = make_folder()
    path = folder / "a-000000.tar"
    member = next(m for m in read_members(path) if m.name == "pick-000001.hand.000002.png")
    data = bytearray(path.read_bytes())
    data[member.offset + member.size - 20] ^= 1
    path.write_bytes(data)
    store = EpisodeStore(folder)
    store.frames(1, "hand", [0, 1, 3])
    with pytest.raises(DataError, match=r"a-000000\.tar: pick-000001\.hand\.000002\.png is a damaged PNG"):
        store.frames(1, "hand", [2])


def test_a_file_cut_off_while_it_is_open_is_named(make_folder):
    folder = make_folder()
    store = EpisodeStore(folder)
    os.truncate(shard(folder), 512)
    with pytest.raises(DataError, match=r"a-000001\.tar: pick-000003\.pose\.npy is cut off"):
        store.pose(3)


def test_a_shard_replaced_while_it_is_open_is_read_as_it_was(make_folder, make_episode, same):
    folder = make_folder()
    store = EpisodeStore(folder)
    write_shard(shard(folder), [make_episode(9)])
    same(store.episode(3), make_episode(3))


def test_threads_read_the_same(make_folder, make_episode, same):
    store = EpisodeStore(make_folder())
    with ThreadPoolExecutor(8) as pool:
        numbers = [0, 4, 2, 1, 3] * 40
        for i, episode in zip(numbers, pool.map(store.episode, numbers), strict=True):
            same(episode, make_episode(i))


@pytest.mark.parametrize("most_open", [0, 1, 256])
def test_any_number_of_open_files_reads_the_same(make_folder, make_episode, same, monkeypatch, most_open):
    monkeypatch.setattr(spans, "_MOST_OPEN", most_open)
    store = EpisodeStore(make_folder())
    for i in range(5):
        same(store.episode(i), make_episode(i))


def test_a_pickled_store_reads_without_searching_again(make_folder, make_episode, same, monkeypatch):
    data = pickle.dumps(EpisodeStore(make_folder()))
    monkeypatch.setattr("geoprior.shards.reader.index_shard", None)
    store = pickle.loads(data)
    same(store.episode(4), make_episode(4))


@pytest.mark.parametrize("method", ["spawn", "fork"])
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_other_processes_read_the_same(make_folder, make_episode, same, method):
    store = EpisodeStore(make_folder())
    same(store.episode(0), make_episode(0))
    context = multiprocessing.get_context(method)
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        same(pool.submit(methodcaller("episode", 4), store).result(), make_episode(4))


def test_a_store_gives_its_files_back(make_folder):
    folder = make_folder()
    before = len(list(Path("/proc/self/fd").iterdir()))
    store = EpisodeStore(folder)
    assert len(list(Path("/proc/self/fd").iterdir())) == before + 2
    del store
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    cut_between_members(folder)
    with pytest.raises(DataError):
        EpisodeStore(folder)
    assert len(list(Path("/proc/self/fd").iterdir())) == before
