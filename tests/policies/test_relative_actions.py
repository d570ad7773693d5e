"""Positions counted from the present one: learned so, and absolute again in every command."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from geoprior.errors import ConfigError, DataError
from geoprior.options import Choice, recipe_tree
from geoprior.policies.act.plugin import ActConfig
from geoprior.policies.checkpoint import (
    CheckpointHeader,
    checkpoint_path,
    load_predictor,
    read_header,
    save_checkpoint,
)
from geoprior.policies.deployed import DeployedPolicy
from geoprior.policies.export_lerobot import export_lerobot
from geoprior.policies.export_onnx import TOLERANCE, export_onnx
from geoprior.policies.normalise import FeatureStatistics, Normaliser, measure, origins
from geoprior.policies.policy import Features
from geoprior.policies.predictor import LoadedPredictor, to_commands

FEATURES = Features(cameras=("hand", "third"), image_size=(40, 64), hands=("hand",), chunk=5)
TWO_HANDS = Features(cameras=("left", "right"), image_size=(40, 64), hands=("left", "right"), chunk=2)
ROWS = np.random.default_rng(0).normal(size=(30, 16)).astype(np.float32)
SIZES = {
    "dim": 16,
    "heads": 2,
    "ffn": 24,
    "encoder_layers": 1,
    "vae_layers": 1,
    "latent": 4,
    "trunk_width": 8,
}
NUMBERS = st.floats(-3.0, 3.0, width=32)


def statistics(hands=1):
    rows = ROWS[:, : 8 * hands]
    return {"pose": measure([rows]), "action": measure([0.4 * rows + 0.1])}


def normaliser(actions, hands=1):
    return Normaliser(statistics(hands), actions=actions)


def observe(features, count=3):
    rng = np.random.default_rng(1)
    shape = (count, *features.image_size, 3)
    frames = {name: rng.integers(256, size=shape, dtype=np.uint8) for name in features.cameras}
    return rng.normal(size=(count, features.pose_size)).astype(np.float32), frames


@given(
    pose=arrays(np.float32, (3, 16), elements=NUMBERS),
    actions=arrays(np.float32, (3, 4, 16), elements=NUMBERS),
)
@pytest.mark.parametrize("kind", ["absolute", "relative"])
def test_what_is_normalised_comes_back(kind, pose, actions):
    both = normaliser(kind, hands=2)
    learned = both.normalise_actions(pose, actions)
    assert learned.dtype == np.float32
    back = both.denormalise_actions(pose, learned)
    assert back.dtype == np.float32
    np.testing.assert_allclose(back, actions, atol=1e-5)


def test_absolute_actions_are_what_they_were_to_the_bit():
    pose, actions = ROWS[:4, :8], ROWS[:20].reshape(4, 5, 16)[..., :8]
    plain = normaliser("absolute")
    assert np.array_equal(plain.normalise_actions(pose, actions), plain.normalise("action", actions))
    assert np.array_equal(plain.denormalise_actions(pose, actions), plain.denormalise("action", actions))
    assert np.isfinite(plain.denormalise_actions(np.full_like(pose, np.nan), actions)).all()


def test_positions_alone_are_counted_from_the_pose():
    pose = ROWS[:1]
    counted = origins(pose, "relative")[0, 0]
    for hand in (0, 8):
        np.testing.assert_array_equal(counted[hand : hand + 3], pose[0, hand : hand + 3])
        assert not counted[hand + 3 : hand + 8].any()
    assert not origins(pose, "absolute").any()


def test_standing_still_is_learned_as_nothing():
    one = FeatureStatistics((0.0,) * 8, (1.0,) * 8, 1)
    unit = Normaliser({"pose": one, "action": one}, actions="relative")
    poses = ROWS[:, :8]
    learned = unit.normalise_actions(poses, np.repeat(poses[:, None], 4, axis=1))
    np.testing.assert_array_equal(learned[..., :3], 0.0)
    np.testing.assert_array_equal(learned[..., 3:], np.repeat(poses[:, None, 3:], 4, axis=1))


def test_moving_the_hand_moves_the_commands_with_it(make_act):
    """A policy that does not look at its pose says the same way from wherever it is."""
    act = make_act()
    with torch.no_grad():
        act.pose_proj.weight.zero_()
    pose, frames = observe(FEATURES)
    said = {}
    for kind in ("absolute", "relative"):
        predictor = LoadedPredictor(act, FEATURES, 10.0, normaliser(kind))
        moved = pose.copy()
        moved[:, :3] += [0.5, -0.25, 0.125]
        said[kind] = predictor.predict(moved, frames) - predictor.predict(pose, frames)
    np.testing.assert_allclose(said["absolute"], 0.0, atol=1e-5)
    np.testing.assert_allclose(said["relative"][..., :3] - [0.5, -0.25, 0.125], 0.0, atol=1e-5)
    np.testing.assert_allclose(said["relative"][..., 3:], 0.0, atol=1e-5)


@pytest.mark.parametrize("features", [FEATURES, TWO_HANDS])
def test_a_deployed_policy_says_the_predictors_commands(make_act, features):
    hands = len(features.hands)
    act, both = make_act(features=features), normaliser("relative", hands)
    pose, frames = observe(features)
    with torch.inference_mode():
        tensors = (torch.from_numpy(frames[name]) for name in features.cameras)
        found = DeployedPolicy(act, both)(torch.from_numpy(pose), *tensors).numpy()
    np.testing.assert_allclose(
        found, LoadedPredictor(act, features, 10.0, both).predict(pose, frames), atol=1e-5
    )


def test_an_absolute_policy_is_deployed_with_nothing_more_than_before(make_act):
    names = DeployedPolicy(make_act(), normaliser("absolute")).state_dict().keys()
    assert {name for name in names if not name.startswith("policy.")} == {
        "pose_mean",
        "pose_std",
        "action_mean",
        "action_std",
    }


@pytest.fixture
def checkpoint(make_act, tmp_path):
    def make(**options):
        act = make_act(**SIZES)
        options = {"chunk": FEATURES.chunk, **SIZES, **options}
        header = CheckpointHeader(
            Choice(name="act", options=options), FEATURES, 10.0, statistics(), 3, 12, {}
        )
        path = checkpoint_path(tmp_path, 3)
        save_checkpoint(path, act.state_dict(), header)
        return path

    return make


def test_a_checkpoint_says_its_kind_and_its_predictor_obeys(checkpoint, make_act):
    pose, frames = observe(FEATURES)
    for options, kind in (({}, "absolute"), ({"actions": "relative"}, "relative")):
        path = checkpoint(**options)
        assert read_header(path).actions == kind
        expected = LoadedPredictor(make_act(**SIZES), FEATURES, 10.0, normaliser(kind)).predict(pose, frames)
        np.testing.assert_array_equal(load_predictor(path).predict(pose, frames), expected)


def test_the_onnx_graph_says_absolute_commands(checkpoint, tmp_path):
    onnxruntime = pytest.importorskip("onnxruntime")
    path = checkpoint(actions="relative")
    exported = export_onnx(path, tmp_path / "policy.onnx")
    assert exported.deviation <= TOLERANCE
    pose, frames = observe(FEATURES, 2)
    session = onnxruntime.InferenceSession(exported.path)
    (found,) = session.run(["action"], {"pose": pose, **frames})
    np.testing.assert_allclose(found, load_predictor(path).predict(pose, frames), atol=1e-4)
    raw = LoadedPredictor(load_predictor(path)._policy, FEATURES, 10.0, normaliser("absolute"))
    counted = to_commands(raw.predict(pose, frames))[..., :3] + pose[:, None, :3]
    np.testing.assert_allclose(found[..., :3], counted, atol=1e-4)


def test_lerobot_is_refused_with_a_remedy(checkpoint, tmp_path):
    with pytest.raises(DataError, match="relative to the present pose; LeRobot's ACT says absolute") as error:
        export_lerobot(checkpoint(actions="relative"), tmp_path / "out")
    assert "export to ONNX" in error.value.hint
    assert not (tmp_path / "out").exists()


def test_an_unknown_kind_in_a_checkpoint_is_named(checkpoint):
    with pytest.raises(ConfigError, match="actions"):
        load_predictor(checkpoint(actions="sideways"))


def test_at_its_default_it_does_not_enter_a_fingerprint():
    assert "actions" not in recipe_tree(ActConfig())
    assert recipe_tree(ActConfig(actions="relative"))["actions"] == "relative"
