from __future__ import annotations

import geoprior_bimanual.carry_together
import geoprior_bimanual.hand_over
import numpy as np
import pytest
from geoprior_bimanual import HANDS

from geoprior.authoring.testing import Case, cases
from geoprior.errors import ConfigError
from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.se3 import apply, invert
from geoprior.options import Choice
from geoprior.scene.scene import Scene
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import Studio, Take

MOTIONS = ("carry-together", "hand-over")
CONFIG = GenerateConfig(fps=10, seconds=6, motions=[Choice(name=name) for name in MOTIONS])
EPISODES = 30


@pytest.fixture(scope="module")
def studio() -> Studio:
    return Studio(CONFIG, CamerasConfig(height=48, width=48), 7)


@pytest.fixture(scope="module")
def takes(studio: Studio) -> dict[str, list[Take]]:
    return {name: [studio.stage(Choice(name=name), index) for index in range(EPISODES)] for name in MOTIONS}


@pytest.mark.parametrize("case", cases(geoprior_bimanual.carry_together, geoprior_bimanual.hand_over))
def test_they_keep_the_contract(case: Case) -> None:
    case.check()


@pytest.mark.parametrize("motion", MOTIONS)
def test_an_episode_has_two_hands_and_three_views(studio: Studio, motion: str) -> None:
    episode = studio.episode(Choice(name=motion), 0)
    episode.validate()
    assert episode.header.hands == ["left", "right"]
    assert sorted(episode.images) == ["left", "right", "third"]
    assert episode.pose.shape == (60, 16)


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_hand_that_holds_the_object_moves_with_it_and_nobody_else_moves_it(
    takes: dict[str, list[Take]], motion: str
) -> None:
    for take in takes[motion]:
        bodies = take.trajectory.transforms_object_to_world
        moves = np.linalg.norm(np.diff(bodies[:, :3, 3], axis=0), axis=1) > 1e-9
        held = np.zeros(len(moves), bool)
        for way in take.trajectory.hands.values():
            holds = (way.gripper[:-1] == 1.0) & (way.gripper[1:] == 1.0)
            in_hand = invert(way.transforms_hand_to_world) @ bodies
            np.testing.assert_allclose(in_hand[1:][holds], in_hand[:-1][holds], atol=1e-9)
            # The gripper opens in the very step in which the object arrives.
            together = np.all(np.isclose(in_hand[1:], in_hand[:-1]), axis=(1, 2))
            held |= holds | ((way.gripper[:-1] == 1.0) & together)
        assert moves.any()
        assert held[moves].all()


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_object_ends_on_its_marker(takes: dict[str, list[Take]], motion: str) -> None:
    for take in takes[motion]:
        trajectory, thing = take.trajectory, take.scene.object
        assert trajectory.marker_points is not None
        end = apply(trajectory.transforms_object_to_world[-1], thing.mesh.vertices)
        assert end[:, 2].min() == pytest.approx(take.scene.floor.height, abs=1e-9)
        low, high = end[:, :2].min(axis=0), end[:, :2].max(axis=0)
        assert (trajectory.marker_points[:, :2] >= low - 1e-9).all()
        assert (trajectory.marker_points[:, :2] <= high + 1e-9).all()


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_cubes_never_meet(takes: dict[str, list[Take]], motion: str) -> None:
    """Some plane across one of either cube's axes parts them at every step."""
    for take in takes[motion]:
        assert _parted(take.scene, take).all()


def _parted(scene: Scene, take: Take) -> np.ndarray:
    ways = {name: way.transforms_hand_to_world for name, way in take.trajectory.hands.items()}
    cubes = {name: apply(way, scene.hands[name].points) for name, way in ways.items()}
    first, second = cubes.values()
    apart = np.zeros(len(first), bool)
    for way in ways.values():
        for axis in range(3):
            one, other = ((cube @ way[:, :3, axis, None])[..., 0] for cube in (first, second))
            apart |= (one.min(axis=1) > other.max(axis=1)) | (other.min(axis=1) > one.max(axis=1))
    return apart


@pytest.mark.parametrize("motion", MOTIONS)
def test_no_cube_is_in_the_object_while_it_is_held(takes: dict[str, list[Take]], motion: str) -> None:
    """The front face parts the cube from the object."""
    for take in takes[motion]:
        vertices = apply(take.trajectory.transforms_object_to_world, take.scene.object.mesh.vertices)
        for way in take.trajectory.hands.values():
            forward = (apply(invert(way.transforms_hand_to_world), vertices))[..., 2]
            assert forward[way.gripper == 1.0].min() >= 0.002 - 1e-9


def test_both_hands_carry_at_the_same_time(takes: dict[str, list[Take]]) -> None:
    for take in takes["carry-together"]:
        left, right = (take.trajectory.hands[name].gripper for name in HANDS)
        np.testing.assert_array_equal(left, right)


def test_one_hand_gives_and_the_other_takes(takes: dict[str, list[Take]]) -> None:
    givers = set()
    for take in takes["hand-over"]:
        closed = {name: np.flatnonzero(take.trajectory.hands[name].gripper) for name in HANDS}
        giver, taker = sorted(HANDS, key=lambda name: closed[name][0])
        begins, ends = (closed[taker][0], closed[giver][-1])
        assert closed[giver][0] < begins <= ends < closed[taker][-1], "both hold it for a while"
        givers.add(giver)
    assert givers == set(HANDS)


def test_a_config_that_mixes_them_with_a_motion_of_one_hand_is_refused() -> None:
    config = CONFIG.model_copy(update={"motions": [Choice(name="carry-together"), Choice(name="pick")]})
    with pytest.raises(ConfigError, match="carry-together moves"):
        Studio(config, CamerasConfig(), 0)
