"""AdamW on weights that a network sees in bfloat16. Importing this module imports numba.

One pass over memory: the gradient is read as it comes, and the bfloat16 copy is written while the float32
weight is at hand.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import prange

from geoprior.compiled import shared

if TYPE_CHECKING:
    from numpy.typing import NDArray

_BLOCK = 2048
"""Numbers taken at a time: all their arrays stay in the first caches."""
_PARTS = 256
"""Sums that a block's is made of, in an order that is written down: vector units can take it as it stands."""


@shared
def update_halves(
    lanes: int,
    weight: NDArray[np.float32],
    mean: NDArray[np.float32],
    square: NDArray[np.float32],
    gradient: NDArray[np.uint16],
    half: NDArray[np.uint16],
    rates: NDArray[np.float32],
) -> None:
    """One step of AdamW (Loshchilov & Hutter 2019) on flat arrays of one length, in place.

    Args:
        lanes: Threads to share the work.
        weight: To be changed.
        mean: Running mean of the gradient.
        square: Running mean of its square.
        gradient: The bits of bfloat16 numbers.
        half: Gets the weight, rounded to the nearest bfloat16, ties to even.
        rates: Factor of the gradient, factor of the weight (its decay), 1 - beta1, beta2, 1 - beta2, step
            size over the first bias correction, root of the second one, epsilon.
    """
    factor, kept, new, old_square, new_square = rates[0], rates[1], rates[2], rates[3], rates[4]
    step, root, epsilon = rates[5], rates[6], rates[7]
    blocks = -(-weight.size // _BLOCK)
    for lane in prange(lanes):
        bits = np.empty(_BLOCK, np.uint32)
        numbers = bits.view(np.float32)
        for block in range(blocks * lane // lanes, blocks * (lane + 1) // lanes):
            first = block * _BLOCK
            last = min(first + _BLOCK, weight.size)
            w, m, v = weight[first:last], mean[first:last], square[first:last]
            g, h = gradient[first:last], half[first:last]
            for i in range(w.size):
                bits[i] = np.uint32(g[i]) << np.uint32(16)
            for i in range(w.size):
                x = numbers[i] * factor
                m[i] += (x - m[i]) * new
                v[i] = v[i] * old_square + x * x * new_square
                w[i] = w[i] * kept - step * m[i] / (np.sqrt(v[i]) / root + epsilon)
                numbers[i] = w[i]
            for i in range(w.size):
                odd = (bits[i] >> np.uint32(16)) & np.uint32(1)
                h[i] = np.uint16((bits[i] + np.uint32(0x7FFF) + odd) >> np.uint32(16))


@shared
def square_sums(lanes: int, gradient: NDArray[np.uint16], sums: NDArray[np.float64]) -> None:
    """The sum of the squares of each block of bfloat16 numbers; blocks do not depend on the lanes.

    Args:
        lanes: Threads to share the work.
        gradient: Flat, the bits of the numbers.
        sums: One for each `block_count`, result.
    """
    for lane in prange(lanes):
        parts = np.empty(_PARTS, np.float32)
        for block in range(sums.size * lane // lanes, sums.size * (lane + 1) // lanes):
            parts[:] = np.float32(0.0)
            for first in range(block * _BLOCK, min((block + 1) * _BLOCK, gradient.size), _PARTS):
                given = gradient[first : first + _PARTS]
                for i in range(given.size):
                    number = np.uint32(np.uint32(given[i]) << np.uint32(16)).view(np.float32)
                    parts[i] += number * number
            left = _PARTS // 2
            while left > 0:
                for i in range(left):
                    parts[i] += parts[left + i]
                left //= 2
            sums[block] = parts[0]


def block_count(size: int) -> int:
    """Blocks that so many numbers make."""
    return -(-size // _BLOCK)
