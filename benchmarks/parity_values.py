"""Weights and inputs by formula: the same numbers for the same name, whatever the version of any library.

So two networks in two environments can be given the same weights without a file that holds them. Needs NumPy
alone.
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def uniform(name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Numbers in [-1, 1): splitmix64 (Steele et al. 2014), seeded by the SHA-256 of the name."""
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    index = np.arange(1, int(np.prod(shape)) + 1, dtype=np.uint64)
    z = index * np.uint64(0x9E3779B97F4A7C15) + np.uint64(seed)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    numbers = (z >> np.uint64(40)).astype(np.float64) / 2.0**23 - 1.0
    return numbers.astype(np.float32).reshape(shape)


def parameter_values(name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """A tensor of weights. No two channels are alike, and signals keep a size at which float32 is precise.

    Args:
        name: LeRobot's, such as ``model.action_head.weight``.
        shape: Of the tensor.
    """
    numbers = uniform(name, shape).astype(np.float64)  # said, for numpy 1 and 2 promote differently
    if len(shape) == 1:
        centre = 1.0 if name.endswith(("weight", "running_var")) else 0.0  # of a norm's scale and variance
        return (centre + 0.5 * numbers).astype(np.float32)
    fan_in = 3.0 if name.endswith("embed.weight") else np.prod(shape[1:], dtype=np.float64)
    return (numbers * np.sqrt(3.0 / fan_in)).astype(np.float32)
