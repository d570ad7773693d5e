"""Planned episodes over many seeds, made once."""

from __future__ import annotations

from functools import cache

import pytest

pytest.register_assert_rewrite("laws")

from motion_material import PRIMITIVES, stage  # noqa: E402

SEEDS = 15 * len(PRIMITIVES)


@cache
def _takes(motion, steps, count, size, options):
    return [stage(motion, index, steps, size, **dict(options)) for index in range(count)]


@pytest.fixture(scope="session")
def takes():
    """``takes(motion, **options)``: planned episodes of 40 steps, each with scene and trajectory."""

    def get(motion, steps=40, count=SEEDS, size=(96, 96), **options):
        return _takes(motion, steps, count, size, tuple(sorted(options.items())))

    return get
