"""Random draws as pure functions of names: no global state, no order of calls."""

from __future__ import annotations

import hashlib
from typing import cast

import numpy as np


def seed_sequence(root: int, *keys: str | int) -> np.random.SeedSequence:
    """The seed sequence of one named draw.

    Args:
        root: The run's root seed, at least 0.
        keys: What the draw is for, for example ``("generate", "pick", 17)``. Words and numbers are
            told apart, so that ``"1"`` and ``1`` give different streams.

    Returns:
        A sequence that depends on nothing but the arguments.
    """
    words = [_word(key) for key in keys]
    return np.random.SeedSequence(entropy=root, spawn_key=tuple(words))


def generator(root: int, *keys: str | int) -> np.random.Generator:
    """A NumPy generator (PCG64) for one named draw; see `seed_sequence`."""
    return np.random.Generator(np.random.PCG64(seed_sequence(root, *keys)))


def child(parent: np.random.Generator, *keys: str | int) -> np.random.Generator:
    """A generator of its own, named under another one: it neither advances it nor depends on what it drew.

    Args:
        parent: One that was seeded by a `numpy.random.SeedSequence`, as every one here.
        keys: What the draw is for. The same keys give the same stream.
    """
    seeds = cast("np.random.SeedSequence", parent.bit_generator.seed_seq)
    words = tuple(_word(key) for key in keys)
    named = np.random.SeedSequence(entropy=seeds.entropy, spawn_key=(*seeds.spawn_key, *words))
    return np.random.Generator(np.random.PCG64(named))


def integer_seed(root: int, *keys: str | int) -> int:
    """A 63-bit seed for libraries that take one integer; see `seed_sequence`."""
    return int(seed_sequence(root, *keys).generate_state(1, np.uint64)[0] >> np.uint64(1))


def _word(key: str | int) -> int:
    digest = hashlib.sha256(repr(key).encode()).digest()
    return int.from_bytes(digest[:8], "big")
