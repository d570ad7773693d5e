import os

import pytest

from geoprior.errors import DataError
from geoprior.shards.archive import ArchiveWriter, read_members
from geoprior.shards.manifest import record_of, write_manifest
from geoprior.shards.stream import iterate
from geoprior.shards.writer import encode_episode


def test_the_stream_gives_every_episode_in_order(make_folder, make_episode, same):
    episodes = list(iterate(make_folder()))
    assert len(episodes) == 5
    for i, episode in enumerate(episodes):
        same(episode, make_episode(i))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # it leaves files open
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_webdataset_reads_a_shard_as_it_is(make_folder, make_episode):
    webdataset = pytest.importorskip("webdataset")
    folder = make_folder()
    samples = list(webdataset.WebDataset(str(folder / "a-000000.tar"), shardshuffle=False))
    assert [sample["__key__"] for sample in samples] == ["pick-000000", "pick-000001", "pick-000002"]
    for i, sample in enumerate(samples):
        members = {name: data for name, data in sample.items() if not name.startswith("__")}
        assert members == dict(encode_episode(make_episode(i)))


def test_a_cut_between_members_is_noticed_though_webdataset_does_not(make_folder):
    folder = make_folder()
    path = folder / "a-000001.tar"
    os.truncate(path, read_members(path)[-1].offset - 512)
    with pytest.raises(DataError, match="cut off"):
        list(iterate(folder))


def write_folder(folder, members):
    with (folder / "a.tar").open("wb") as file:
        archive = ArchiveWriter(file.write)
        for suffix, content in members:
            archive.add(f"pick-000000.{suffix}", content)
        archive.close()
    write_manifest(folder, [record_of(folder / "a.tar")])


BOOM = b"cbuiltins\nexec\n(Vraise SystemExit('unpickled')\ntR."


@pytest.mark.parametrize(
    "suffix", ["extra.pkl", "extra.pyd", "extra.pth", "pickle", "EXTRA.PKL", "extra.pkl.gz"]
)
def test_pickled_members_are_refused_and_never_loaded(tmp_path, make_episode, suffix):
    write_folder(tmp_path, [*sorted(encode_episode(make_episode())), (suffix, BOOM)])
    with pytest.raises(DataError, match="pickled members are refused"):
        list(iterate(tmp_path))


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda members: members[:-1], "members are missing"),
        (lambda members: [*members, members[-1]], "duplicate"),
        (lambda members: [(s, b"{" if s == "json" else c) for s, c in members], "json: the whole"),
        (lambda members: [(s, c[:-1] if s == "pose.npy" else c) for s, c in members], "pick-000000"),
        (
            lambda members: [(s, c[:-1] if s == "hand.000001.png" else c) for s, c in members],
            r"hand\.000001\.png is a PNG that was cut off",
        ),
    ],
)
def test_samples_that_are_not_whole_are_refused(tmp_path, make_episode, change, fault):
    write_folder(tmp_path, change(sorted(encode_episode(make_episode()))))
    with pytest.raises(DataError, match=fault):
        list(iterate(tmp_path))
