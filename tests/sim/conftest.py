from __future__ import annotations

import pytest
from quick_demos import fast_episodes

from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice

__all__ = ["fast_episodes"]

SIZE = 64


@pytest.fixture(scope="session")
def cameras() -> CamerasConfig:
    return CamerasConfig(height=SIZE, width=SIZE)


@pytest.fixture(scope="session")
def pick() -> Choice:
    return plugins().resolve("task", Choice(name="pick"))


@pytest.fixture(scope="session")
def ur5e() -> Choice:
    return plugins().resolve("robot", Choice(name="ur5e"))


@pytest.fixture(scope="session")
def env(ur5e, pick, cameras):
    """The UR5e at its table, built once; every test resets it."""
    from geoprior.sim.workers import Setup, environment

    return environment(Setup(ur5e, pick, cameras), 10)


@pytest.fixture(scope="session")
def place_env(ur5e, cameras):
    """The UR5e with a cube and an enclosure."""
    from geoprior.sim.workers import Setup, environment

    return environment(Setup(ur5e, Choice(name="place"), cameras), 10)


@pytest.fixture(scope="session")
def push_env(ur5e, cameras):
    """The UR5e with a cube and a coloured area."""
    from geoprior.sim.workers import Setup, environment

    return environment(Setup(ur5e, Choice(name="push"), cameras), 10)
