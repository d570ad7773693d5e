"""The compiled encoder against other people's readers, and its tar members against the plain writer's."""

from __future__ import annotations

import io
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from PIL import Image

from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice
from geoprior.shards._deflate_code import binary_code, canonical_codes, huffman_lengths
from geoprior.shards.archive import ArchiveWriter
from geoprior.shards.binary_png import encode_binary_png, encode_members
from geoprior.shards.writer import write_samples, write_shard
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import Studio

SHAPES = st.tuples(st.integers(1, 40), st.integers(1, 150))
# Runs of either colour, so that long ones and their borders are met, and noise.
RUNS = st.lists(st.tuples(st.booleans(), st.integers(1, 9000)), min_size=1, max_size=12)


def from_runs(runs, shape):
    flat = np.concatenate([np.full(length, white) for white, length in runs])
    return np.resize(np.append(flat, False), shape)


def read(data):
    """By OpenCV, Pillow and zlib, which all check the file's checksums."""
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    pillow = Image.open(io.BytesIO(data))
    pillow.verify()
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(data))), image > 0)
    begin = data.index(b"IDAT") + 4
    size = int.from_bytes(data[begin - 8 : begin - 4], "big")
    rows = np.frombuffer(zlib.decompress(data[begin : begin + size]), np.uint8).reshape(len(image), -1)
    assert not rows[:, 0].any(), "rows are not filtered"
    np.testing.assert_array_equal(np.unpackbits(rows[:, 1:], axis=1, count=image.shape[1]), image > 0)
    return image > 0


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_any_frame_is_read_back_by_others(data):
    shape = data.draw(SHAPES)
    frame = data.draw(st.one_of(npst.arrays(bool, shape), RUNS.map(lambda runs: from_runs(runs, shape))))
    np.testing.assert_array_equal(read(encode_binary_png(np.packbits(frame, axis=1), shape[1])), frame)


@pytest.mark.parametrize("white", [False, True])
@pytest.mark.parametrize("shape", [(1, 1), (480, 640), (97, 101), (16, 2056), (2160, 3840)])
def test_one_colour_alone_at_every_size(shape, white):
    frame = np.full(shape, white)
    np.testing.assert_array_equal(read(encode_binary_png(np.packbits(frame, axis=1), shape[1])), frame)


@pytest.mark.parametrize("black", [*range(1, 12), 257, 258, 259, 260, 261, 517, 518, 519, 775, 776, 777, 778])
def test_black_runs_around_the_longest_match(black):
    frame = np.zeros((1, 8 * (black + 2)), bool)
    frame[0, 0] = frame[0, -1] = True
    np.testing.assert_array_equal(read(encode_binary_png(np.packbits(frame, axis=1), frame.shape[1])), frame)


def test_what_a_rows_last_byte_has_too_many_is_as_given():
    packed = np.zeros((2, 2), np.uint8)
    packed[0, 0] = 0b10000000
    assert read(encode_binary_png(packed, 9)).sum() == 1


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 12), SHAPES, st.integers(0, 2**32 - 1), st.integers(0, 999_988))
def test_members_are_those_of_the_plain_writer(count, shape, seed, first):
    rng = np.random.default_rng(seed)
    packed = np.packbits(rng.random((count, *shape)) < rng.choice([0.01, 0.5]), axis=-1)
    parts = []
    archive = ArchiveWriter(lambda content: parts.append(bytes(content)))
    for n, frame in enumerate(packed):
        archive.add(f"pick-000123.hand.{first + n:06d}.png", encode_binary_png(frame, shape[1]))
    assert encode_members(packed, shape[1], "pick-000123.hand.000000.png", first).tobytes() == b"".join(parts)


def test_a_member_name_too_long_is_refused():
    with pytest.raises(ValueError, match="longer than 100"):
        encode_members(np.zeros((1, 2, 1), np.uint8), 8, "k" * 95 + ".000000.png", 0)


def test_the_code_is_a_whole_prefix_code():
    for weights in ([1, 2, 3, 4, 5], [7] * 286, [1, *[1000] * 9, *[0] * 5, 3]):
        lengths = huffman_lengths(weights)
        assert [length == 0 for length in lengths] == [weight == 0 for weight in weights]
        assert sum(2.0**-length for length in lengths if length) == 1.0
        words = [
            f"{code:0{length}b}"[::-1]
            for code, length in zip(canonical_codes(lengths), lengths, strict=True)
            if length
        ]
        assert not any(a != b and b.startswith(a) for a in words for b in words)
    assert len(set(binary_code().literal.tolist())) == 256


def test_no_frame_becomes_much_longer_and_sparse_ones_are_as_short_as_zlibs():
    rng = np.random.default_rng(0)
    noise = np.packbits(rng.random((96, 96)) < 0.5, axis=1)
    assert noise.size < len(encode_binary_png(noise, 96)) < 1.4 * noise.size + 120
    ours = theirs = 0
    for height, width in ((96, 96), (480, 640)):
        config = GenerateConfig(fps=2)
        cameras = CamerasConfig(height=height, width=width)
        for motion in config.motions:
            sample = Studio(config, cameras, 0).sample(motion, 0)
            for blocks in sample.frames.values():
                for packed in np.concatenate(list(blocks)):
                    rows = np.pad(packed, ((0, 0), (1, 0))).tobytes()
                    ours += len(encode_binary_png(packed, width))
                    theirs += 57 + len(zlib.compress(rows, 1))
    assert ours < theirs


def test_a_sample_and_an_episode_in_memory_give_the_same_shard(tmp_path):
    config, cameras = GenerateConfig(fps=3, seconds=4), CamerasConfig(height=50, width=70)
    studio = Studio(config, cameras, 5)
    wanted = [(motion, index) for motion in config.motions for index in (0, 3)]
    one = write_samples(tmp_path / "a.tar", (studio.sample(*each) for each in wanted))
    other = write_shard(tmp_path / "b.tar", (studio.episode(*each) for each in wanted))
    assert one.sha256 == other.sha256
    alone = Studio(config, cameras, 5).episode(Choice(name="push"), 3)
    np.testing.assert_array_equal(
        alone.images["third"], studio.episode(Choice(name="push"), 3).images["third"]
    )


def test_blocks_are_cut_without_a_trace(tmp_path, monkeypatch):
    studio = Studio(GenerateConfig(fps=3, seconds=4), CamerasConfig(height=50, width=70), 5)
    whole = write_samples(tmp_path / "a.tar", [studio.sample(Choice(name="place"), 0)])
    monkeypatch.setattr("geoprior.shards.sample._BLOCK_BYTES", 3 * 50 * 9 + 1)
    assert sum(1 for _ in studio.sample(Choice(name="place"), 0).frames["hand"]) == 4
    parts = write_samples(tmp_path / "b.tar", [studio.sample(Choice(name="place"), 0)])
    assert whole.sha256 == parts.sha256
