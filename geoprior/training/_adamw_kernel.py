"""AdamW on weights that a network sees in bfloat16. Importing this module imports numba.

One pass over memory: the gradient is read as it comes, and the bfloat16 copy is written while the float32
weight is at hand.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

_BLOCK = 2048
"""Numbers taken at a time: all their arrays stay in the first caches."""


@compiled
def update_halves(
    weight: NDArray[np.float32],
    mean: NDArray[np.float32],
    square: NDArray[np.float32],
    gradient: NDArray[np.uint16],
    half: NDArray[np.uint16],
    rates: NDArray[np.float32],
) -> None:
    """One step of AdamW (Loshchilov & Hutter 2019) on flat arrays of one length, in place.

    Args:
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
    bits = np.empty(_BLOCK, np.uint32)
    numbers = bits.view(np.float32)
    for first in range(0, weight.size, _BLOCK):
        w, m, v = weight[first : first + _BLOCK], mean[first : first + _BLOCK], square[first : first + _BLOCK]
        g, h = gradient[first : first + _BLOCK], half[first : first + _BLOCK]
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
