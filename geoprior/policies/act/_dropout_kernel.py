"""Masks of dropout. Importing this module imports numba; the first call compiles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray


_BLOCK = 4096
"""Numbers made at a time: their words stay in the first cache."""


@compiled
def fill_mask(seed: int, dropped: int, kept: NDArray[Any], out: NDArray[Any]) -> None:
    """Set each number to the one kept, or to 0 with a probability of ``dropped`` in 256.

    Eight numbers share a word of splitmix64 (Steele et al. 2014), a byte each.

    Args:
        seed: Of 63 bits.
        dropped: Bytes below it drop.
        kept: (1,) the number's bits, as an unsigned integer of its size.
        out: Flat, of the same type.
    """
    golden, one = np.uint64(0x9E3779B97F4A7C15), np.uint64(1)
    value = kept[0]
    none = value ^ value
    words = np.empty(_BLOCK // 8, np.uint64)
    levels = words.view(np.uint8)
    state = np.uint64(seed)
    for first in range(0, out.size, _BLOCK):
        for word in range(words.size):
            z = state + (np.uint64(word) + one) * golden
            z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            words[word] = z ^ (z >> np.uint64(31))
        state += np.uint64(words.size) * golden
        block = out[first : first + _BLOCK]
        for place in range(block.size):
            block[place] = none if levels[place] < dropped else value
