"""A few small synthetic episodes, staged once, and a demonstration that tells nothing but its poses."""

import pytest

from geoprior.config import load_config
from geoprior.hooks.manager import plugins
from geoprior.synthesis.studio import Studio
from geoprior.view.subject import staged_subject
from geoprior.view.world import world_of

SMALL = ("cameras.height=32", "cameras.width=32", "generate.seconds=0.8", "generate.episodes=3")


@pytest.fixture(scope="session")
def make_studio():
    """The studio of a small config, with whatever else is set."""

    def make(*settings):
        config = load_config("lite", [*SMALL, *settings], plugins())
        return Studio(config.generate, config.cameras, config.seed)

    return make


@pytest.fixture(scope="session")
def studio(make_studio):
    return make_studio()


@pytest.fixture(scope="session")
def push(studio):
    """A push with its points: 8 steps, two cameras of 32 x 32, a marker."""
    return staged_subject(studio, "push-000001")


@pytest.fixture(scope="session")
def place(studio):
    """A place with its points: its gripper closes and opens again."""
    return staged_subject(studio, "place-000001")


@pytest.fixture(scope="session")
def world(push):
    return world_of(push.episode.header, push.episode.pose, push.bodies)


@pytest.fixture(scope="session")
def bare_header(push):
    """The header of an episode that tells poses and cameras only, as a demonstration's does."""
    return push.episode.header.model_copy(update={"details": {}, "source": "simulated", "motion": "lift"})
