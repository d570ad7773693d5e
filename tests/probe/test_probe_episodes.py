import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from probe_material import CHUNK, features, square_episodes

from geoprior.config import load_config
from geoprior.errors import DataError
from geoprior.geometry.seeding import integer_seed
from geoprior.hooks.manager import plugins
from geoprior.probe.episodes import MOMENTS, ROOT, fresh_episodes, generated_source, partners_of, rows_of
from geoprior.synthesis.studio import Studio


@given(counts=st.dictionaries(st.sampled_from("abcdef"), st.integers(2, 40), min_size=1), order=st.randoms())
def test_an_episode_gets_the_images_of_another_one_of_its_motion(counts, order):
    motions = [name for name, count in counts.items() for _ in range(count)]
    order.shuffle(motions)
    partners = partners_of(motions)
    assert all(partners != np.arange(len(motions)))
    assert [motions[partner] for partner in partners] == motions
    assert sorted(partners) == list(range(len(motions)))
    assert np.array_equal(partners, partners_of(motions))


def test_one_episode_of_a_motion_cannot_be_shuffled():
    with pytest.raises(DataError, match="'push' has one episode") as caught:
        partners_of(["pick", "pick", "push"], "runs/x")
    assert "runs/x" in caught.value.message
    assert "--episodes" in caught.value.hint


def test_moments_are_spread_over_every_episode_and_partners_look_at_a_like_time():
    episodes = square_episodes(6, steps=17)
    rows = rows_of(episodes, features(episodes), 1)
    assert len(rows) == 6 * MOMENTS
    times = rows.steps[:, 0].reshape(6, MOMENTS)
    assert (np.diff(times, axis=1) > 0).all()
    assert times.min() < 17 / MOMENTS
    assert times.max() >= 17 * (1 - 1 / MOMENTS)
    assert np.array_equal(rows.steps[rows.partners, 0], rows.steps[:, 0])
    assert (rows.slots[rows.partners] != rows.slots).all()
    assert rows.valid.shape == (len(rows), CHUNK)


@pytest.fixture(scope="module")
def quickstart():
    overrides = ("generate.seconds=1", "cameras.height=32", "cameras.width=32")
    return load_config("lite", overrides, plugins())


def test_fresh_episodes_are_none_of_the_run_and_the_same_every_time(quickstart):
    make = quickstart.generate, quickstart.cameras, quickstart.seed
    first, second = fresh_episodes(*make, 2), fresh_episodes(*make, 3)
    seen = generated_source(quickstart.generate, quickstart.cameras, quickstart.seed, 3)
    assert first.motions == ["pick", "place", "push"] * 2
    for slot in range(6):
        assert np.array_equal(first.source.poses[slot], second.source.poses[slot])
        assert not any(np.array_equal(first.source.poses[slot], pose) for pose in seen.poses)


def test_what_a_run_learned_from_is_made_again(quickstart):
    source = generated_source(quickstart.generate, quickstart.cameras, quickstart.seed, 2)
    studio = Studio(quickstart.generate, quickstart.cameras, quickstart.seed)
    episode = studio.episode(quickstart.generate.motions[1], 1)
    assert np.array_equal(source.poses[4], episode.pose)
    assert np.array_equal(source.actions[4], episode.action)


def test_the_object_is_where_each_camera_shows_it(quickstart):
    """By the header's own positions and camera transforms."""
    episodes = fresh_episodes(quickstart.generate, quickstart.cameras, 5, 2)
    studio = Studio(quickstart.generate, quickstart.cameras, integer_seed(5, ROOT))
    take = studio.stage(quickstart.generate.motions[0], 1)
    header = studio.sample(quickstart.generate.motions[0], 1).header
    last = header.steps - 1
    found = episodes.object_places(len(quickstart.generate.motions), np.array([0, last]))
    assert list(found) == ["hand", "third"]
    for camera in header.cameras:
        to_world = np.array(camera.transform_camera_to_mount)
        for row, (step, key) in enumerate([(0, "position"), (last, "final_position")]):
            mounted = to_world
            if camera.mount != "world":
                mounted = take.trajectory.hand.transforms_hand_to_world[step] @ to_world
            point = mounted[:3, :3].T @ (np.array(header.details["object"][key]) - mounted[:3, 3])
            np.testing.assert_allclose(found[camera.name][row], point[:2], atol=1e-9)
