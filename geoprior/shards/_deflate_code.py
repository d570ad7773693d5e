"""The Huffman code with which binary frames are compressed (DEFLATE, RFC 1951), fixed once and for all.

A compressor fits its code to each frame; ours fits one code to what such frames hold: runs of black, and
bytes with the edge of a small white square in them. The frame is then coded in one pass over its white
bytes, the file is smaller than zlib's at level 1, and its bytes do not depend on which zlib a machine has.
Any code is valid for any frame; a frame of another kind only gets longer.
"""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

Bits = tuple[int, int]
"""Some bits, the first of them lowest, and how many."""

_END = 256
_LONGEST = 258
_LENGTH_ORDER = (16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15)


class BinaryCode(NamedTuple):
    """Tables for the compiled encoder.

    A symbol is ``bits << 5 | count``: so many bits, of which the lowest is written first. A symbol here may
    be several of DEFLATE's in a row.

    Attributes:
        head: Bytes before the first symbol: block type and code lengths.
        head_rest: Symbol of the unfinished byte after them.
        literal: (256,) int64, the symbol of a byte.
        fresh: (260,) int64, that of a run of so many zero bytes after another byte.
        further: (259,) int64, that of so many more zero bytes after a zero byte.
        end: The symbol of the block's end.
        crc: (8, 256) int64: CRC-32 of a byte that 0 to 7 zero bytes follow, for eight bytes at a time.
    """

    head: NDArray[np.uint8]
    head_rest: int
    literal: NDArray[np.int64]
    fresh: NDArray[np.int64]
    further: NDArray[np.int64]
    end: int
    crc: NDArray[np.int64]


@lru_cache(maxsize=1)
def binary_code() -> BinaryCode:
    """Build the tables (some ms)."""
    lengths = huffman_lengths(_weights())
    codes = canonical_codes(lengths)
    literal = [(codes[symbol], lengths[symbol]) for symbol in range(256)]
    further = [(0, 0), *(_join([literal[0]] * count) for count in (1, 2))]
    further += [_match(length, codes, lengths) for length in range(3, _LONGEST + 1)]
    fresh = [(0, 0), *(_join([literal[0], more]) for more in further)]
    head = _join(_block_head(lengths))
    whole, rest = head[1] // 8, head[1] % 8
    return BinaryCode(
        head=np.frombuffer(head[0].to_bytes(whole + 1, "little")[:whole], np.uint8),
        head_rest=(head[0] >> 8 * whole) << 5 | rest,
        literal=_table(literal),
        fresh=_table(fresh),
        further=_table(further),
        end=codes[_END] << 5 | lengths[_END],
        crc=_crc_table(),
    )


def _table(symbols: Sequence[Bits]) -> NDArray[np.int64]:
    return np.array([bits << 5 | count for bits, count in symbols], np.int64)


def _join(parts: Iterable[Bits]) -> Bits:
    """Bits one after the other."""
    bits, count = 0, 0
    for more, how_many in parts:
        bits, count = bits | more << count, count + how_many
    return bits, count


def _weights() -> list[int]:
    """How often a symbol occurs in frames of 2 x 2 squares, of 64 to 640 columns: of some 10,000.

    Only a black byte, a white one and one with an edge of one square in it are told apart from the rest:
    finer classes save less than their code lengths take in the block's head.
    """
    weights = [8] * _END + [20] + [64] * 20 + [32] * 9
    weights[0x00], weights[0xFF] = 3000, 256
    for byte in (0x01, 0x03, 0x06, 0x0C, 0x18, 0x30, 0x60, 0xC0, 0x80):
        weights[byte] = 450
    return weights


def huffman_lengths(weights: Sequence[int]) -> list[int]:
    """Length of each symbol's code, 0 where the weight is; ties are broken by the order of the symbols."""
    order = itertools.count()
    heap: list[tuple[int, int, tuple[int, ...]]] = [
        (weight, next(order), (symbol,)) for symbol, weight in enumerate(weights) if weight
    ]
    heapq.heapify(heap)
    lengths = [0] * len(weights)
    while len(heap) > 1:
        (first, _, some), (second, _, others) = heapq.heappop(heap), heapq.heappop(heap)
        for symbol in some + others:
            lengths[symbol] += 1
        heapq.heappush(heap, (first + second, next(order), some + others))
    return lengths


def canonical_codes(lengths: Sequence[int]) -> list[int]:
    """Codes by RFC 1951, section 3.2.2, their first bit lowest."""
    codes, code, last = [0] * len(lengths), 0, 0
    for length, symbol in sorted((length, symbol) for symbol, length in enumerate(lengths) if length):
        code <<= length - last
        codes[symbol], last = int(f"{code:0{length}b}"[::-1], 2), length
        code += 1
    return codes


def _length_symbol(length: int) -> tuple[int, int, int]:
    """Symbol of a match's length, its extra bits and how many (RFC 1951, section 3.2.5)."""
    if length == _LONGEST:
        return 285, 0, 0
    if length < 11:
        return 254 + length, 0, 0
    extra = (length - 3).bit_length() - 3
    return 257 + 4 * extra + ((length - 3) >> extra), (length - 3) & ((1 << extra) - 1), extra


def _match(length: int, codes: Sequence[int], lengths: Sequence[int]) -> Bits:
    symbol, *extra = _length_symbol(length)
    distance = 0, 1  # the only one, 1, has the code 0
    return _join([(codes[symbol], lengths[symbol]), (extra[0], extra[1]), distance])


def _block_head(lengths: Sequence[int]) -> list[Bits]:
    """The bits that begin a last block with a code of its own: RFC 1951, section 3.2.7."""
    tokens = list(_shortened([*lengths, 1]))
    counts = Counter(symbol for symbol, _, _ in tokens)
    their_lengths = huffman_lengths([counts[symbol] for symbol in range(19)])
    their_codes = canonical_codes(their_lengths)
    ordered = [their_lengths[symbol] for symbol in _LENGTH_ORDER]
    fields = [(1, 1), (2, 2), (len(lengths) - 257, 5), (0, 5), (len(ordered) - 4, 4)]
    fields += [(length, 3) for length in ordered]
    for symbol, extra, extra_bits in tokens:
        fields += [(their_codes[symbol], their_lengths[symbol]), (extra, extra_bits)]
    return fields


def _shortened(lengths: Sequence[int]) -> Iterator[tuple[int, int, int]]:
    """Code lengths with their repetitions: ``(symbol, extra bits, how many)``; 16 repeats 3 to 6 times."""
    for length, run in itertools.groupby(lengths):
        yield length, 0, 0
        more = len(list(run)) - 1
        while more >= 3:
            yield 16, min(more, 6) - 3, 2
            more -= min(more, 6)
        yield from [(length, 0, 0)] * more


def _crc_table() -> NDArray[np.int64]:
    table = np.zeros((8, 256), np.int64)
    table[0] = np.arange(256)
    for _ in range(8):
        table[0] = table[0] >> 1 ^ np.where(table[0] & 1, 0xEDB88320, 0)
    for after in range(1, 8):
        table[after] = table[after - 1] >> 8 ^ table[0, table[after - 1] & 255]
    return table
