import gc
import io
import sys
import tracemalloc
import zlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from geoprior.episode import FrameFormat
from geoprior.shards.codec import (
    decode_header,
    decode_npy,
    decode_png,
    encode_header,
    encode_levels_png,
    encode_npy,
    encode_png,
)

SIDES = st.integers(1, 40)
BITS = st.tuples(SIDES, SIDES).flatmap(lambda shape: hnp.arrays(np.bool_, shape))
GRAYS = st.tuples(SIDES, SIDES).flatmap(lambda shape: hnp.arrays(np.uint8, shape))
COLOURS = st.tuples(SIDES, SIDES).flatmap(lambda shape: hnp.arrays(np.uint8, (*shape, 3)))


def as_frame(bits):
    return np.where(bits, 255, 0).astype(np.uint8)


def decode(data, shape, one_channel="binary"):
    kind = "rgb" if len(shape) == 3 else one_channel
    return decode_png(data, FrameFormat(kind, *shape[:2]))


def pillow_png(frame, mode):
    file = io.BytesIO()
    Image.fromarray(frame).convert(mode).save(file, "png")
    return file.getvalue()


@given(BITS)
def test_binary_frames_survive_and_other_readers_see_the_same(bits):
    frame = as_frame(bits)
    data = encode_png(frame)
    np.testing.assert_array_equal(decode(data, frame.shape), frame)
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED), frame)
    image = Image.open(io.BytesIO(data))
    assert image.mode == "1"
    np.testing.assert_array_equal(np.asarray(image), bits)


@given(COLOURS)
def test_colour_frames_survive_in_rgb_order(frame):
    data = encode_png(frame)
    np.testing.assert_array_equal(decode(data, frame.shape), frame)
    image = Image.open(io.BytesIO(data))
    assert image.mode == "RGB"
    np.testing.assert_array_equal(np.asarray(image), frame)


@given(GRAYS)
def test_gray_frames_survive_and_other_readers_see_the_same(frame):
    data = encode_levels_png(frame)
    assert data == encode_levels_png(np.asfortranarray(frame))
    np.testing.assert_array_equal(decode(data, frame.shape, "gray"), frame)
    image = Image.open(io.BytesIO(data))
    assert image.mode == "L"
    np.testing.assert_array_equal(np.asarray(image), frame)
    np.testing.assert_array_equal(decode(pillow_png(frame, "L"), frame.shape, "gray"), frame)


@given(BITS)
def test_binary_frames_of_other_writers_are_read(bits):
    frame = as_frame(bits)
    one_bit, eight_bits = pillow_png(frame, "1"), pillow_png(frame, "L")
    filtered = cv2.imencode(".png", frame, [cv2.IMWRITE_PNG_BILEVEL, 1])[1].tobytes()
    for data in (one_bit, eight_bits, filtered):
        np.testing.assert_array_equal(decode(data, frame.shape), frame)


@given(COLOURS)
def test_colour_frames_of_other_writers_are_read(frame):
    np.testing.assert_array_equal(decode(pillow_png(frame, "RGB"), frame.shape), frame)


@pytest.mark.parametrize("value", [1, 127, 254])
def test_a_binary_frame_with_another_value_is_refused(value):
    frame = np.zeros((4, 4), np.uint8)
    frame[2, 1] = value
    with pytest.raises(ValueError, match=f"value {value}"):
        encode_png(frame)


@settings(max_examples=300)
@given(st.data(), st.sampled_from([(9, 13), (5, 7, 3)]))
def test_every_flipped_bit_is_noticed(data, shape):
    rng = np.random.default_rng(len(shape))
    frame = rng.integers(2, size=shape).astype(np.uint8) * np.uint8(255)
    good = encode_png(frame)
    bit = data.draw(st.integers(0, 8 * len(good) - 1))
    bad = bytearray(good)
    bad[bit // 8] ^= 1 << bit % 8
    with pytest.raises(ValueError, match=r"PNG|pixels"):
        decode(bytes(bad), shape)


@pytest.mark.parametrize("shape", [(9, 13), (5, 7, 3)])
def test_every_cut_and_every_appendix_is_noticed(shape):
    good = encode_png(np.zeros(shape, np.uint8))
    for size in range(len(good)):
        with pytest.raises(ValueError, match="PNG"):
            decode(good[:size], shape)
    with pytest.raises(ValueError, match="goes on"):
        decode(good + b"\0", shape)


def test_another_size_or_kind_is_named():
    binary, colour = np.zeros((4, 6), np.uint8), np.zeros((4, 6, 3), np.uint8)
    with pytest.raises(ValueError, match="is 4 x 6 pixels, not 6 x 4"):
        decode(encode_png(binary), (6, 4))
    with pytest.raises(ValueError, match="has 1 channels of uint8, not 3"):
        decode(encode_png(binary), (4, 6, 3))
    with pytest.raises(ValueError, match="has 3 channels of uint8, not 1"):
        decode(encode_png(colour), (4, 6))
    with pytest.raises(ValueError, match="has 4 channels"):
        decode(pillow_png(colour, "RGBA"), (4, 6, 3))
    deep = cv2.imencode(".png", np.zeros((4, 6), np.uint16))[1].tobytes()
    with pytest.raises(ValueError, match="uint16"):
        decode(deep, (4, 6))


def test_another_kind_than_gray_is_named():
    gray, colour = np.full((4, 6), 7, np.uint8), np.zeros((4, 6, 3), np.uint8)
    with pytest.raises(ValueError, match="has 3 channels of uint8, not 1"):
        decode(encode_png(colour), (4, 6), "gray")
    with pytest.raises(ValueError, match="has 1 channels of uint8, not 3"):
        decode(encode_levels_png(gray), (4, 6, 3))
    with pytest.raises(ValueError, match="neither 0 nor 255"):
        decode(encode_levels_png(gray), (4, 6))
    with pytest.raises(ValueError, match="is 4 x 6 pixels, not 6 x 4"):
        decode(encode_levels_png(gray), (6, 4), "gray")


def test_grey_levels_in_a_binary_view_are_refused():
    grey = np.full((4, 6), 128, np.uint8)
    with pytest.raises(ValueError, match="neither 0 nor 255"):
        decode(pillow_png(grey, "L"), (4, 6))


def test_too_many_pixels_in_a_small_frame_are_not_unpacked():
    frame = np.zeros((4, 8), np.uint8)
    small = encode_png(frame)
    bomb = zlib.compress(bytes(10_000_000))
    chunk = len(bomb).to_bytes(4, "big") + b"IDAT" + bomb + zlib.crc32(b"IDAT" + bomb).to_bytes(4, "big")
    begin, end = small.index(b"IDAT") - 4, small.index(b"IEND") - 4
    data = small[:begin] + chunk + small[end:]
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="too many pixels"):
            decode(data, frame.shape)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


@given(hnp.arrays(np.float32, hnp.array_shapes(min_dims=2, max_dims=2)))
def test_poses_survive_to_the_bit(array):
    for given_array in (array, np.asfortranarray(array), array.astype(">f4")):
        data = encode_npy(given_array)
        assert data == encode_npy(array)
    back = decode_npy(data)
    assert back.dtype == np.float32
    assert back.tobytes() == array.tobytes()
    assert back.shape == array.shape


def test_pickled_arrays_are_never_loaded():
    file = io.BytesIO()
    np.save(file, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match=r"damaged header|expected '<f4'"):
        decode_npy(file.getvalue())


def test_other_or_damaged_arrays_are_refused():
    file = io.BytesIO()
    np.save(file, np.zeros((3, 8)))
    with pytest.raises(ValueError, match="holds '<f8'"):
        decode_npy(file.getvalue())
    good = encode_npy(np.zeros((3, 8), np.float32))
    with pytest.raises(ValueError, match="goes on"):
        decode_npy(good + b"\0")
    for size in range(len(good)):
        with pytest.raises(ValueError):  # noqa: PT011 - NumPy words it in several ways
            decode_npy(good[:size])


def test_a_flipped_bit_in_an_arrays_header_is_refused_or_changes_nothing():
    """Whatever NumPy's parser of headers makes of it, and without memory for what a shape claims."""
    array = np.arange(24, dtype=np.float32).reshape(3, 8)
    good = encode_npy(array)
    end = len(good) - array.nbytes
    for bit in range(8 * end):
        data = bytearray(good)
        data[bit // 8] ^= 1 << bit % 8
        with suppress(ValueError):
            assert decode_npy(bytes(data)).tobytes() == array.tobytes()


def test_headers_survive_and_have_one_form(make_episode):
    header = make_episode(details={"b": 1, "a": {"é": [1.5, None]}}).header
    data = encode_header(header)
    assert decode_header(data) == header
    assert encode_header(decode_header(data)) == data


def test_bits_stand_in_a_header_only_where_the_channels_do_not_tell(make_episode):
    header = make_episode().header
    assert b"bits" not in encode_header(header)
    gray = header.cameras[0].model_copy(update={"bits": 8})
    data = encode_header(header.model_copy(update={"cameras": [gray, header.cameras[1]]}))
    assert data.count(b'"bits":8') == 1
    assert [camera.frame_format.kind for camera in decode_header(data).cameras] == ["gray", "rgb"]
    said = encode_header(header).replace(b'"channels":1', b'"bits":1,"channels":1')
    assert decode_header(said).cameras[0].frame_format.kind == "binary"
    with pytest.raises(ValueError, match="8 bits a channel"):
        decode_header(encode_header(header).replace(b'"channels":3', b'"bits":1,"channels":3'))


def test_headers_that_are_not_json_or_not_headers_are_refused(make_episode):
    with pytest.raises(ValueError, match="JSON"):
        encode_header(make_episode(details={"a": float("nan")}).header)
    with pytest.raises(ValueError, match="serializable"):
        encode_header(make_episode(details={"a": np.float32(1)}).header)
    with pytest.raises(ValueError, match="the whole"):
        decode_header(b"{")
    good = encode_header(make_episode().header)
    with pytest.raises(ValueError, match="fps"):
        decode_header(good.replace(b'"fps":10.0', b'"fps":0'))
    with pytest.raises(ValueError, match=r"cameras\.0\.name"):
        decode_header(good.replace(b'"name":"hand"', b'"name":"../hand"'))


class _Cycle:
    """Garbage that runs Python when it is collected."""

    def __init__(self) -> None:
        self.itself = self

    def __del__(self) -> None:
        sum(range(3))


def test_poses_are_decoded_in_many_threads_while_garbage_is_collected():
    """CPython before 3.11.8 parses a literal in one thread at a time, and NumPy's header is one."""
    data = encode_npy(np.arange(8, dtype=np.float32).reshape(2, 4))

    def decode(_):
        for _ in range(100):
            _Cycle()
            assert decode_npy(data)[1, 3] == 7.0

    interval, thresholds = sys.getswitchinterval(), gc.get_threshold()
    sys.setswitchinterval(1e-6)
    gc.set_threshold(5, 1, 1)
    try:
        with ThreadPoolExecutor(8) as pool:
            list(pool.map(decode, range(40)))
    finally:
        sys.setswitchinterval(interval)
        gc.set_threshold(*thresholds)
