"""Binary frames to PNG files of one bit a pixel, and to whole tar members, by the compiled encoder."""

from __future__ import annotations

import struct
import zlib
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from geoprior.shards.archive import BLOCK, member_header

if TYPE_CHECKING:
    from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_FRAME_OVERHEAD = 2 * BLOCK
"""Bytes of a member beyond its pixels, at most: tar header, padding, PNG's other parts, the code's head."""


def pack_white(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Pack frames (..., H, W) of 0 and 255 into (..., H, ceil(W / 8)), as `numpy.packbits` does.

    Raises:
        ValueError: They hold another value.
    """
    white = frames == 255
    if np.count_nonzero(white) != np.count_nonzero(frames):
        other = frames[~white & (frames != 0)][0]
        raise ValueError(f"holds the value {other}; a binary frame has 0 and 255 only")
    return np.packbits(white, axis=-1)


def encode_binary_png(packed: NDArray[np.uint8], width: int) -> bytes:
    """Encode one frame.

    Args:
        packed: (H, ceil(W / 8)) uint8; see `geoprior.render.packing.pack_frames`.
        width: W.
    """
    from geoprior.shards._deflate_code import binary_code
    from geoprior.shards._frames_kernel import put_png

    height, row_bytes = packed.shape
    out = _room(packed[None])
    end = put_png(binary_code(), _words(packed[None])[0], row_bytes, _png_head(height, width), out, 0)
    return out[:end].tobytes()


def encode_members(packed: NDArray[np.uint8], width: int, name: str, first: int) -> NDArray[np.uint8]:
    """Encode frames as neighbouring members of a tar.

    Args:
        packed: (n, H, ceil(W / 8)) uint8.
        width: W.
        name: Of the camera's first frame: ends with ``000000.png``.
        first: Step of the first of these frames.

    Returns:
        The members' bytes, headers and padding included.

    Raises:
        ValueError: The name is not ASCII or has more than 100 characters.
    """
    from geoprior.shards._deflate_code import binary_code
    from geoprior.shards._frames_kernel import put_members

    _, height, row_bytes = packed.shape
    header = np.frombuffer(member_header(name, 0), np.uint8)
    out = _room(packed)
    end = put_members(
        binary_code(),
        _words(packed),
        row_bytes,
        _png_head(height, width),
        header,
        len(name) - len(".png") - 1,
        first,
        out,
    )
    return out[:end]


@lru_cache(maxsize=8)
def _png_head(height: int, width: int) -> NDArray[np.uint8]:
    part = b"IHDR" + struct.pack(">II5B", width, height, 1, 0, 0, 0, 0)
    content = _SIGNATURE + struct.pack(">I", len(part) - 4) + part + struct.pack(">I", zlib.crc32(part))
    return np.frombuffer(content, np.uint8)


def _words(packed: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """(n, H, words): rows lengthened to whole words where they are not."""
    missing = -packed.shape[-1] % 8
    padded = np.pad(packed, ((0, 0), (0, 0), (0, missing))) if missing else np.ascontiguousarray(packed)
    return padded.view(np.uint64)


def _room(packed: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A buffer for the members: no code is longer than two bytes."""
    frames, height, row_bytes = packed.shape
    return np.empty(frames * (2 * height * (row_bytes + 1) + _FRAME_OVERHEAD), np.uint8)
