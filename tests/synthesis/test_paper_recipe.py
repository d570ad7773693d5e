"""The paper's own recipe is the reference that others are compared with: new options leave it as it was."""

import numpy as np
import pytest

from geoprior.config import load_config
from geoprior.hooks.manager import plugins
from geoprior.options import Options, recipe_tree
from geoprior.synthesis.studio import Studio

SEED, INDEX = 7, 3
SMALL = ("cameras.height=64", "cameras.width=64", "generate.fps=10", "pretrain.skip=1")
# Taken before other renderers and scenes were added.
PINNED = {
    "pick": (
        "12f6917da156ae78d6bf3f93018a917e17e7e1c50c70e69d8fbda949cfd00c29",
        {"hand": 24438, "third": 50083},
        [-0.1457, 0.1131, 0.0273, 0.8431, 0.5377, 0.0, 0.0, 1.0],
    ),
    "place": (
        "db85c9139c4202727b8ef145b3d22baf71ef58e21c9e80b20a22d154ec677742",
        {"hand": 26692, "third": 48010},
        [0.2021, -0.1048, 0.1327, 0.9901, 0.1402, 0.0, 0.0, 0.0],
    ),
    "push": (
        "0e2b2346598665ab0f8c7fbb0ac6be0ad9969463594c28f58bf1c639d5e5d242",
        {"hand": 92098, "third": 68553},
        [0.2499, 0.1107, 0.0549, 0.3189, 0.6311, 0.6311, 0.3189, 0.0],
    ),
}
"""By motion: the recipe's hash, white pixels of all frames, and the last pose."""


@pytest.mark.parametrize("motion", PINNED)
def test_the_papers_episodes_are_what_they_were(motion):
    config = load_config("paper", SMALL, plugins())
    studio = Studio(config.generate, config.cameras, SEED)
    recipe, white, last = PINNED[motion]
    choice = next(each for each in config.generate.motions if each.name == motion)
    episode = studio.episode(choice, INDEX)
    assert studio.recipe(choice) == recipe
    assert {name: int((frames > 0).sum()) for name, frames in episode.images.items()} == white
    np.testing.assert_allclose(episode.pose[-1], last, atol=1e-4)


class Inner(Options):
    later = frozenset({"new"})
    old: int = 1
    new: int = 2


class Outer(Options):
    later = frozenset({"added"})
    inner: Inner = Inner()
    added: Inner = Inner()


def test_a_later_field_enters_a_recipe_only_where_it_says_something():
    assert recipe_tree(Outer()) == {"inner": {"old": 1}}
    assert recipe_tree(Outer(inner=Inner(new=3))) == {"inner": {"old": 1, "new": 3}}
    assert recipe_tree(Outer(added=Inner(old=5))) == {"inner": {"old": 1}, "added": {"old": 5}}
    assert Outer().model_dump() == {"inner": {"old": 1, "new": 2}, "added": {"old": 1, "new": 2}}
