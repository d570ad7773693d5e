"""Planned episodes over many seeds, made once."""

from __future__ import annotations

from functools import cache

import pytest

from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice
from geoprior.shards.config import GenerateConfig
from geoprior.shards.synthesis import stage_episode

SEEDS = 100


@cache
def _takes(motion, steps, count, options):
    config = GenerateConfig(fps=steps, seconds=1.0)
    choice = Choice(name=motion, options=dict(options))
    return [stage_episode(config, CamerasConfig(), 11, choice, index) for index in range(count)]


@pytest.fixture(scope="session")
def takes():
    """``takes(motion, **options)``: planned episodes of 40 steps, each with scene and trajectory."""

    def get(motion, steps=40, count=SEEDS, **options):
        return _takes(motion, steps, count, tuple(sorted(options.items())))

    return get
