"""Binary frames to PNG files and tar members, compiled. Importing this module imports numba.

A frame is coded in one pass over its white bytes: black runs are a match with the byte before them, and the
checksum of the pixels (Adler-32) is summed over the white bytes alone. All numbers are int64: numba makes a
float of int64 with uint64.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.shards._deflate_code import BinaryCode

BLOCK = 512
"""Bytes of a tar's block."""

_LONGEST = 258
_ADLER = 65521
_IDAT = np.frombuffer(b"IDAT", np.uint8)
_IEND = np.frombuffer(b"\0\0\0\0IEND\xaeB\x60\x82", np.uint8)


@compiled
def _crc32(table: NDArray[np.int64], data: NDArray[np.uint8], begin: int, end: int) -> int:
    crc, at = 0xFFFFFFFF, begin
    while at + 8 <= end:
        low = crc ^ (data[at] | data[at + 1] << 8 | data[at + 2] << 16 | data[at + 3] << 24)
        crc = (
            table[7, low & 255]
            ^ table[6, low >> 8 & 255]
            ^ table[5, low >> 16 & 255]
            ^ table[4, low >> 24 & 255]
            ^ table[3, data[at + 4]]
            ^ table[2, data[at + 5]]
            ^ table[1, data[at + 6]]
            ^ table[0, data[at + 7]]
        )
        at += 8
    while at < end:
        crc = crc >> 8 ^ table[0, (crc ^ data[at]) & 255]
        at += 1
    return crc ^ 0xFFFFFFFF


@compiled
def _put_big_endian(out: NDArray[np.uint8], at: int, value: int) -> int:
    for byte in range(4):
        out[at + byte] = value >> 24 - 8 * byte & 255
    return at + 4


@compiled
def _put_bytes(out: NDArray[np.uint8], at: int, content: NDArray[np.uint8]) -> int:
    for byte in range(len(content)):
        out[at + byte] = content[byte]
    return at + len(content)


@compiled
def _put_whole_bytes(out: NDArray[np.uint8], at: int, bits: int, count: int) -> tuple[int, int, int]:
    while count >= 8:
        out[at] = bits & 255
        at, bits, count = at + 1, bits >> 8, count - 8
    return at, bits, count


@compiled
def _put_symbol(symbol: int, out: NDArray[np.uint8], at: int, bits: int, count: int) -> tuple[int, int, int]:
    """Append a symbol's bits to fewer than 32 that wait."""
    bits |= symbol >> 5 << count
    count += symbol & 31
    if count < 32:
        return at, bits, count
    for byte in range(4):
        out[at + byte] = bits >> 8 * byte & 255
    return at + 4, bits >> 32, count - 32


@compiled
def _put_run(
    fresh: NDArray[np.int64],
    further: NDArray[np.int64],
    run: int,
    out: NDArray[np.uint8],
    at: int,
    bits: int,
    count: int,
) -> tuple[int, int, int]:
    """Append a run of zero bytes."""
    step = min(run, _LONGEST + 1)
    at, bits, count = _put_symbol(fresh[step], out, at, bits, count)
    while step < run:
        more = min(run - step, _LONGEST)
        at, bits, count = _put_symbol(further[more], out, at, bits, count)
        step += more
    return at, bits, count


@compiled
def _deflate(
    code: BinaryCode, frame: NDArray[np.uint64], row_bytes: int, out: NDArray[np.uint8], at: int
) -> tuple[int, int]:
    """Code a frame as PNG's unfiltered scanlines; returns where it ends and the scanlines' Adler-32."""
    literal, fresh, further = code.literal, code.fresh, code.further
    height, words = frame.shape
    size = height * (row_bytes + 1)
    at = _put_bytes(out, at, code.head)
    at, bits, count = _put_symbol(code.head_rest, out, at, 0, 0)
    run, first_sum, second_sum = 0, np.int64(0), np.int64(0)
    for row in range(height):
        run += 1  # each scanline begins with its filter, 0
        for word in range(words):
            pixels = frame[row, word]
            inside = min(8, row_bytes - 8 * word)
            if pixels == 0:
                run += inside
                continue
            for byte in range(inside):
                value = np.int64(pixels >> np.uint64(8 * byte) & np.uint64(255))
                if value == 0:
                    run += 1
                    continue
                if run > 0:
                    at, bits, count = _put_run(fresh, further, run, out, at, bits, count)
                    run = 0
                at, bits, count = _put_symbol(literal[value], out, at, bits, count)
                first_sum += value
                second_sum += value * (size - (row * (row_bytes + 1) + 1 + 8 * word + byte))
    at, bits, count = _put_run(fresh, further, run, out, at, bits, count)
    at, bits, count = _put_symbol(code.end, out, at, bits, count)
    at, bits, count = _put_whole_bytes(out, at, bits, count + 7)
    return at, int((size + second_sum) % _ADLER << 16 | (1 + first_sum) % _ADLER)


@compiled
def put_png(
    code: BinaryCode,
    frame: NDArray[np.uint64],
    row_bytes: int,
    head: NDArray[np.uint8],
    out: NDArray[np.uint8],
    at: int,
) -> int:
    """Write a frame as a PNG file.

    Args:
        code: See `geoprior.shards._deflate_code.binary_code`.
        frame: (H, words) uint64, eight bytes of packed pixels a word.
        row_bytes: Bytes of a row; what a row's last word has beyond them is not looked at.
        head: The file's first two parts, signature and IHDR.
        out: Written to.
        at: Where to begin.

    Returns:
        Where the file ends.
    """
    length_at = _put_bytes(out, at, head)
    data_at = _put_bytes(out, length_at + 4, _IDAT)
    out[data_at], out[data_at + 1] = 0x78, 0x01
    end, adler = _deflate(code, frame, row_bytes, out, data_at + 2)
    end = _put_big_endian(out, end, adler)
    _put_big_endian(out, length_at, end - data_at)
    end = _put_big_endian(out, end, _crc32(code.crc, out, data_at - 4, end))
    return _put_bytes(out, end, _IEND)


@compiled
def put_members(
    code: BinaryCode,
    frames: NDArray[np.uint64],
    row_bytes: int,
    head: NDArray[np.uint8],
    header: NDArray[np.uint8],
    step_at: int,
    first: int,
    out: NDArray[np.uint8],
) -> int:
    """Write frames as the members of a tar, one after the other.

    Args:
        code: See `put_png`.
        frames: (N, H, words); see `put_png`.
        row_bytes: See `put_png`.
        head: See `put_png`.
        header: (512,) the tar header of the camera's frame 0, but with zeros for its size.
        step_at: Where the last of the six digits of the step stands in the name.
        first: Step of the first frame.
        out: Written to from its beginning.

    Returns:
        How many bytes were written.
    """
    at = 0
    for n in range(len(frames)):
        begin = at + BLOCK
        end = put_png(code, frames[n], row_bytes, head, out, begin)
        _put_bytes(out, at, header)
        _put_digits(out, at + step_at, first + n, 10)
        _put_digits(out, at + _SIZE_AT, end - begin, 8)
        _put_checksum(out, at)
        at = begin + (end - begin + BLOCK - 1) // BLOCK * BLOCK
        out[end:at] = 0
    return at


_SIZE_AT, _CHECKSUM_AT = 134, 148
"""Of a ustar header: the last digit of the size, the first of the checksum."""


@compiled
def _put_digits(out: NDArray[np.uint8], last: int, value: int, base: int) -> None:
    while value > 0:
        out[last] = 48 + value % base
        value //= base
        last -= 1


@compiled
def _put_checksum(out: NDArray[np.uint8], at: int) -> None:
    """Six octal digits, zero, space: the sum of the header's bytes, with spaces in the checksum's place."""
    for byte in range(8):
        out[at + _CHECKSUM_AT + byte] = 32
    total = 0
    for byte in range(BLOCK):
        total += out[at + byte]
    for digit in range(6):
        out[at + _CHECKSUM_AT + digit] = 48
    _put_digits(out, at + _CHECKSUM_AT + 5, total, 8)
    out[at + _CHECKSUM_AT + 6] = 0
