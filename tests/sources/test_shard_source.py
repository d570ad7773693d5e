import json
import shutil
import tarfile

import numpy as np
import pytest
from source_material import CAMERAS, SLOTS, make_batches, read, same_moments

from geoprior.errors import DataError
from geoprior.shards.reader import EpisodeStore
from geoprior.sources.shards import ShardSource


def test_it_says_of_itself_what_the_store_says(source_of, shards):
    source, store = source_of("shards"), EpisodeStore(shards)
    assert (source.cameras, source.fps, source.digest) == (store.cameras, store.fps, store.digest)
    assert source.image_size == (CAMERAS.height, CAMERAS.width)
    assert len(source) == len(store) == SLOTS
    for i in range(SLOTS):
        assert np.array_equal(source.poses[i], store.pose(i))
        assert np.array_equal(source.actions[i], store.action(i))


def test_a_moment_is_what_the_shard_holds(source_of, shards):
    store = EpisodeStore(shards)
    moments = read(source_of("shards"), [4, 0], [7, 2], chunk=3)
    for row, (episode, time) in enumerate([(4, 7), (0, 2)]):
        assert np.array_equal(moments.pose[row], store.pose(episode)[time])
        assert np.array_equal(moments.action[row], store.action(episode)[time : time + 3])
        for camera in ("hand", "third"):
            assert np.array_equal(moments.frames[camera][row], store.frames(episode, camera, [time])[0])


def test_every_epoch_has_the_same_episodes(source_of):
    source = source_of("shards")
    first = read(source, [1, 5, 3], [0, 9, 4])
    later = read(source, [1 + 7 * SLOTS, 5 + SLOTS, 3 + 10**9 * SLOTS], [0, 9, 4])
    assert same_moments(first, later)


class CountingStore:
    def __init__(self, store):
        self.store, self.reads = store, 0

    def __getattr__(self, name):
        return getattr(self.store, name)

    def __len__(self):
        return len(self.store)

    def frames(self, *arguments):
        self.reads += 1
        return self.store.frames(*arguments)


@pytest.mark.parametrize(("room", "reads"), [(0, 8), (3, 5), (100, 4)])
def test_kept_frames_are_not_read_again_and_are_the_same(shards, room, reads):
    """Two moments of two cameras, twice; ``room`` is in frames."""
    store = CountingStore(EpisodeStore(shards))
    source = ShardSource(store, room * CAMERAS.height * CAMERAS.width)
    first = read(source, [2, 3], [1, 8])
    assert store.reads == 4
    assert same_moments(read(source, [2, 3], [1, 8]), first)
    assert store.reads == reads


def test_a_damaged_frame_is_named_by_file_and_member(shards, tmp_path):
    folder = tmp_path / "damaged"
    shutil.copytree(shards, folder)
    shard = folder / json.loads((folder / "manifest.json").read_text())["shards"][0]["file"]
    with tarfile.open(shard) as tar:
        member = next(m for m in tar.getmembers() if m.name.endswith(".third.000003.png"))
    content = bytearray(shard.read_bytes())
    content[member.offset_data : member.offset_data + 8] = b"scribble"
    shard.write_bytes(content)
    batches = make_batches(ShardSource(EpisodeStore(folder)), prefetch=2)
    with pytest.raises(DataError) as caught:
        list(batches.stream(0, 200))
    assert str(shard) in str(caught.value)
    assert member.name in str(caught.value)


def test_closing_twice_is_no_fault(source_of):
    source = source_of("shards")
    source.close()
    source.close()
