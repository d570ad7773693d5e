"""Raw observations in, commands that obey the pose contract out."""

import numpy as np
import pytest
import torch

from geoprior.errors import DataError
from geoprior.policies.normalise import Normaliser, measure, normalise_images
from geoprior.policies.policy import Features
from geoprior.policies.predictor import LoadedPredictor, to_commands

FEATURES = Features(cameras=("hand", "third"), image_size=(40, 64), hands=("hand",), chunk=5)
ROWS = np.random.default_rng(0).normal(size=(30, 8)).astype(np.float32)


@pytest.fixture
def make_predictor(make_act):
    def make(**options):
        normaliser = Normaliser({"pose": measure([ROWS]), "action": measure([2 * ROWS + 1])})
        return LoadedPredictor(make_act(seed=2, **options), FEATURES, 10.0, normaliser)

    return make


def observe(count, seed=0, channels=3):
    rng = np.random.default_rng(seed)
    frames = {name: rng.integers(256, size=(count, 40, 64, 3), dtype=np.uint8) for name in FEATURES.cameras}
    if channels == 1:
        frames = {
            name: np.where(frame[..., 0] > 127, np.uint8(255), np.uint8(0)) for name, frame in frames.items()
        }
    return rng.normal(size=(count, 8)).astype(np.float32), frames


def test_commands_obey_the_pose_contract(make_predictor):
    commands = make_predictor().predict(*observe(3))
    assert commands.shape == (3, 5, 8)
    assert commands.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(commands[..., 3:7], axis=-1), 1.0, atol=1e-6)
    assert set(np.unique(commands[..., 7])) <= {0.0, 1.0}


def test_it_is_the_policy_between_normalisation_and_its_inverse(make_predictor, make_act):
    pose, frames = observe(2)
    stacked = torch.from_numpy(np.stack([frames["hand"], frames["third"]], axis=1))
    raw = (
        make_act(seed=2)
        .eval()
        .predict(
            {
                "pose": torch.from_numpy((pose - ROWS.mean(0)) / ROWS.std(0)),
                "images": normalise_images(stacked),
            }
        )
    )
    expected = raw.numpy() * (2 * ROWS + 1).std(0) + (2 * ROWS + 1).mean(0)
    found = make_predictor().predict(pose, frames)
    np.testing.assert_allclose(found[..., :3], expected[..., :3], atol=1e-5)


@pytest.mark.parametrize("rows", [1, 2, 4, 7])
def test_mates_in_a_batch_of_one_size_do_not_matter_in_the_last_bit(make_predictor, rows):
    """At the sizes of the quickstart, where the fast kernels are at work; a mate may even be NaN."""
    predictor = make_predictor(dim=64, heads=4, ffn=128, trunk_width=16)
    pose, frames = observe(rows)
    together = predictor.predict(pose, frames)
    others_pose, others_frames = observe(rows, seed=1)
    others_pose[:] *= 50.0
    others_pose[0, 0] = np.nan
    for row in range(rows):
        others_pose[row] = pose[row]
        for name, frame in others_frames.items():
            frame[row] = frames[name][row]
        apart = predictor.predict(others_pose, others_frames)
        assert np.array_equal(apart[row], together[row])
        others_pose[row] = np.nan


def test_binary_frames_are_white_and_black_ones(make_predictor):
    predictor = make_predictor()
    pose, frames = observe(2, channels=1)
    in_colour = {name: np.repeat(frame[..., None], 3, axis=-1) for name, frame in frames.items()}
    assert np.array_equal(predictor.predict(pose, frames), predictor.predict(pose, in_colour))
    mixed = {"hand": frames["hand"], "third": in_colour["third"]}
    assert np.array_equal(predictor.predict(pose, frames), predictor.predict(pose, mixed))


def test_the_order_of_the_mapping_does_not_matter(make_predictor):
    predictor = make_predictor()
    pose, frames = observe(2)
    assert np.array_equal(
        predictor.predict(pose, frames), predictor.predict(pose, dict(reversed(frames.items())))
    )


def test_wrong_observations_are_named(make_predictor):
    predictor = make_predictor()
    pose, frames = observe(2)
    with pytest.raises(DataError, match="looks through the cameras hand, third; it was given hand"):
        predictor.predict(pose, {"hand": frames["hand"]})
    with pytest.raises(DataError, match=r"pose: expected \(B, 8\), found \(2, 7\)"):
        predictor.predict(pose[:, :7], frames)
    with pytest.raises(DataError, match="camera 'third': expected uint8"):
        predictor.predict(pose, {**frames, "third": frames["third"][:, :20]})
    with pytest.raises(DataError, match="camera 'hand': expected uint8"):
        predictor.predict(pose, {**frames, "hand": frames["hand"].astype(np.float32)})


@pytest.mark.parametrize("number", [0, 5, 7])
def test_an_action_that_is_not_finite_is_so_in_all_its_numbers(make_act, number):
    act = make_act()
    with torch.no_grad():
        act.action_head.bias[number] = torch.nan
    normaliser = Normaliser({"pose": measure([ROWS]), "action": measure([ROWS])})
    commands = LoadedPredictor(act, FEATURES, 10.0, normaliser).predict(*observe(1))
    assert np.isnan(commands).all()


def test_an_observation_that_is_not_finite_spoils_its_own_row_alone(make_predictor):
    pose, frames = observe(3)
    pose[1, 2] = np.nan
    commands = make_predictor().predict(pose, frames)
    assert np.isnan(commands[1]).all()
    assert np.isfinite(commands[[0, 2]]).all()


def test_two_hands_are_treated_alike():
    actions = np.arange(32, dtype=np.float32).reshape(2, 16) - 7.0
    actions[:, 7], actions[:, 15] = 0.49, 0.51
    commands = to_commands(actions)
    assert commands[:, [7, 15]].tolist() == [[0.0, 1.0], [0.0, 1.0]]
    np.testing.assert_allclose(np.linalg.norm(commands[:, 11:15], axis=-1), 1.0, atol=1e-6)
    np.testing.assert_array_equal(commands[:, 8:11], actions[:, 8:11])


@pytest.mark.parametrize("shape", [(2, 40, 64, 4), (2, 40, 64, 2), (2, 40, 64, 3, 1), (2, 40), (40, 64, 3)])
def test_frames_have_one_channel_or_three(shape, make_predictor):
    pose, frames = observe(2)
    frames["hand"] = np.zeros(shape, np.uint8)
    with pytest.raises(DataError, match="camera 'hand': expected uint8"):
        make_predictor().predict(pose, frames)


@pytest.mark.parametrize("shape", [(), (8,), (2, 8, 1)])
def test_a_pose_has_two_axes(shape, make_predictor):
    _, frames = observe(2)
    with pytest.raises(DataError, match="pose: expected"):
        make_predictor().predict(np.zeros(shape, np.float32), frames)
