"""Targets in training: heads that learn them, and that leave no trace when they are off or done."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from training_material import SIZE, TINY_ACT, FakeStore, make_demonstration, make_training

from geoprior.errors import ConfigError
from geoprior.options import Choice, recipe_tree
from geoprior.policies.act.plugin import ActConfig
from geoprior.policies.checkpoint import list_checkpoints, load_checkpoint, load_predictor
from geoprior.policies.policy import Features
from geoprior.policies.targets import FARTHEST, UNIT, scale_targets
from geoprior.sources.shards import ShardSource
from geoprior.training.config import ConditionConfig, PretrainConfig, TrainConfig
from geoprior.training.loop import fit
from geoprior.training.machine import Machine
from geoprior.training.resume import RESUME_NAME
from geoprior.training.stages import Job, _require_targets, build_policy, train

NAMES = ("object.hand.right", "object.hand.up", "object.third.column", "object.third.row", "marker.hand.up")
FEATURES = Features(("hand", "third"), (SIZE, SIZE), ("hand",), 4)
WITH_TARGETS = replace(FEATURES, targets=NAMES)


def act(**options):
    return Choice(name="act", options={**TINY_ACT.options, **options})


class Described(FakeStore):
    """Episodes that know where their bright square is; there is no marker."""

    target_names = NAMES

    def targets(self, i):
        aim = np.nonzero(self.episodes[i].images["third"][0].reshape(SIZE, SIZE))
        row, column = (2.0 * place.mean() / SIZE - 1.0 for place in aim)
        values = [0.1 * column, 0.1 * row, column, row, np.nan]
        return np.tile(np.array(values, np.float32), (len(self.pose(i)), 1))


@pytest.fixture
def store():
    return Described([make_demonstration(index, steps=6 + index) for index in range(5)])


def trained(store, folder, choice, *, epochs=6, precision="fp32", **options):
    options = {"batch_size": 4, "threads": 1, "precision": precision, "log_every": 1, **options}
    config = PretrainConfig(epochs=epochs, **options)
    job = Job("pretrain", 0, ConditionConfig(init="scratch"), None, folder)
    return train(config, job, choice, ShardSource(store), Machine("cpu", precision, 1))


def weights(folder):
    return load_checkpoint(list_checkpoints(folder)[-1].path)[1]


def batch_of(features, rows=3):
    generator = torch.Generator().manual_seed(0)
    draw = {"generator": generator}
    return {
        "pose": torch.randn(rows, features.pose_size, **draw),
        "images": torch.randn(rows, 2, 3, SIZE, SIZE, **draw),
        "action": torch.randn(rows, features.chunk, features.pose_size, **draw),
        "valid": torch.ones(rows, features.chunk, dtype=torch.bool),
        "targets": torch.randn(rows, len(NAMES), **draw),
    }


def loss_of(policy, batch):
    torch.manual_seed(0)
    return policy.loss(batch)


def test_targets_are_scaled_clipped_and_nan_stays_nan():
    raw = np.array([[0.15, -0.3, 4.0, -1.2, np.nan], [3.0, 0.0, -9.0, np.nan, 0.0]], np.float32)
    scaled = scale_targets([*NAMES[:4], "lamp.brightness"], raw)
    np.testing.assert_allclose(scaled[0, :4], [1.0, -2.0, FARTHEST, -1.2], rtol=1e-6)
    assert np.isnan(scaled[0, 4])
    np.testing.assert_allclose(scaled[1, [0, 2, 4]], [3.0 / UNIT, -FARTHEST, 0.0], rtol=1e-6)


@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_a_policy_that_learns_no_targets_is_the_same_to_the_bit_on_data_that_have_them(
    store, tmp_path, precision
):
    plain = FakeStore(store.episodes)
    trained(store, tmp_path / "with", act(), precision=precision)
    trained(plain, tmp_path / "without", act(), precision=precision)
    for name, tensor in weights(tmp_path / "without").items():
        assert torch.equal(weights(tmp_path / "with")[name], tensor)


def test_heads_do_not_change_the_other_first_weights():
    plain, taught = build_policy(act(), FEATURES, 3), build_policy(act(target_weight=2.0), WITH_TARGETS, 3)
    assert taught.state_dict().keys() - plain.state_dict().keys() == {
        name for name in taught.state_dict() if name.startswith("target_heads.")
    }
    for name, tensor in plain.state_dict().items():
        assert torch.equal(taught.state_dict()[name], tensor)


@pytest.mark.parametrize(("options", "features"), [({}, WITH_TARGETS), ({"target_weight": 2.0}, FEATURES)])
def test_without_a_weight_or_without_names_there_are_no_heads(options, features):
    assert build_policy(act(**options), features, 0).target_heads is None


def test_their_loss_is_added_with_its_weight():
    batch = batch_of(WITH_TARGETS)
    one, two = (build_policy(act(target_weight=w, dropout=0.0), WITH_TARGETS, 0).eval() for w in (1.0, 3.0))
    (first, scalars), (second, _) = loss_of(one, batch), loss_of(two, batch)
    torch.testing.assert_close(second - first, 2.0 * scalars["target_l1"])
    halves = scalars["target_l1_trunk"] + scalars["target_l1_encoder"]
    torch.testing.assert_close(scalars["target_l1"], 0.5 * halves)


def test_their_gradients_reach_the_trunk_and_the_encoder():
    policy = build_policy(act(target_weight=1.0), WITH_TARGETS, 0).eval()
    batch = batch_of(WITH_TARGETS)
    image_tokens, memory, _ = policy.encode(batch, torch.zeros(3, 4))
    for seen, name in (
        ("trunk", "trunk.layer4.1.conv2.weight"),
        ("encoder", "encoder.layers.0.linear2.weight"),
    ):
        policy.zero_grad()
        tokens = {"trunk": image_tokens, "encoder": memory}[seen]
        said = getattr(policy.target_heads, seen)(tokens)
        said.square().sum().backward(retain_graph=True)
        assert dict(policy.named_parameters())[name].grad.abs().sum() > 0


def test_what_is_not_known_is_not_learned():
    policy = build_policy(act(target_weight=1.0, dropout=0.0), WITH_TARGETS, 0).eval()
    batch = batch_of(WITH_TARGETS)
    batch["targets"][1, 2] = torch.nan
    batch["targets"][:, 4] = torch.nan
    loss, scalars = loss_of(policy, batch)
    image_tokens = policy.encode(batch, torch.zeros(3, 4))[0]
    errors = (policy.target_heads.trunk(image_tokens) - batch["targets"]).abs()
    torch.testing.assert_close(scalars["target_l1_trunk"], errors.nanmean())
    loss.backward()
    assert policy.target_heads.trunk[-1].weight.grad[4].abs().sum() == 0.0
    assert all(torch.isfinite(each.grad).all() for each in policy.parameters() if each.grad is not None)


def test_with_nothing_known_the_loss_is_that_of_the_actions_and_every_head_has_a_gradient():
    """The processes of torchrun add up the gradients of the same parameters, whatever their batches hold."""
    policy = build_policy(act(target_weight=1.0, dropout=0.0), WITH_TARGETS, 0).eval()
    batch = batch_of(WITH_TARGETS)
    batch["targets"][:] = torch.nan
    loss, scalars = loss_of(policy, batch)
    torch.testing.assert_close(loss.detach(), scalars["l1"] + policy.config.kl_weight * scalars["kl"])
    loss.backward()
    assert all(each.grad is not None and not each.grad.any() for each in policy.target_heads.parameters())


@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_targets_are_learned_and_logged(store, tmp_path, precision):
    options = {"learning_rate": 3e-3, "held_out": 0.2, "checkpoint_every": 60, "image_noise": 0.0}
    choice = act(target_weight=2.0, dropout=0.0)
    result = trained(store, tmp_path, choice, epochs=120, precision=precision, **options)
    lines = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert lines[-1]["target_l1"] < 0.4 * lines[0]["target_l1"]
    assert {"target_l1_trunk", "target_l1_encoder", "target_hand_cm"} <= lines[0].keys()
    assert "held_out_target_l1" in result["metrics"]


def test_checkpoints_hold_no_heads_and_a_prediction_needs_none(store, tmp_path):
    trained(store, tmp_path, act(target_weight=2.0))
    path = list_checkpoints(tmp_path)[-1].path
    header, tensors = load_checkpoint(path)
    assert header.features == FEATURES
    assert "targets" not in json.loads(path.with_suffix(".json").read_text())["features"]
    assert not [name for name in tensors if name.startswith("target_heads.")]
    predictor = load_predictor(path)
    frames = {name: np.zeros((2, SIZE, SIZE), np.uint8) for name in FEATURES.cameras}
    pose = np.tile(np.array([0, 0, 0, 0, 0, 0, 1, 0], np.float32), (2, 1))
    assert predictor.predict(pose, frames).shape == (2, 4, 8)


def test_a_fine_tuning_without_targets_begins_from_such_a_prior(store, tmp_path):
    choice = act(target_weight=2.0)
    trained(store, tmp_path / "prior", choice)
    prior = list_checkpoints(tmp_path / "prior")[-1].path
    job = Job("finetune", 0, ConditionConfig(init="prior"), prior, tmp_path / "tuned")
    config = TrainConfig(epochs=2, batch_size=4, threads=1, precision="fp32", log_every=1)
    train(config, job, choice, ShardSource(FakeStore(store.episodes)), Machine("cpu", "fp32", 1))
    line = json.loads((tmp_path / "tuned" / "log.jsonl").read_text().splitlines()[0])
    assert "target_l1" not in line


class StoppedError(Exception):
    """A training that ends in its middle."""


@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_heads_are_resumed_to_the_bit(store, tmp_path, monkeypatch, precision):
    options = {"resume_seconds": 0.0, "precision": precision, "image_noise": 0.0}
    trained(store, tmp_path / "whole", act(target_weight=2.0), **options)
    from geoprior.training import loop

    plain, calls = loop.take_step, []

    def stopping(*arguments):
        calls.append(1)
        if len(calls) > 4:
            raise StoppedError
        return plain(*arguments)

    monkeypatch.setattr(loop, "take_step", stopping)
    with pytest.raises(StoppedError):
        trained(store, tmp_path / "cut", act(target_weight=2.0), **options)
    monkeypatch.setattr(loop, "take_step", plain)
    assert (tmp_path / "cut" / RESUME_NAME).exists()
    trained(store, tmp_path / "cut", act(target_weight=2.0), **options)
    for name, tensor in weights(tmp_path / "whole").items():
        assert torch.equal(weights(tmp_path / "cut")[name], tensor)
    logs = [(tmp_path / name / "log.jsonl").read_text().splitlines()[-1] for name in ("whole", "cut")]
    first, second = (json.loads(line)["target_l1"] for line in logs)
    assert first == second


def test_parts_of_a_batch_learn_the_same_targets(store, tmp_path):
    """What the trunk's head says depends on the images alone: the style is drawn for each part."""
    found = []
    choice = act(target_weight=2.0, trunk_norm="frozen", dropout=0.0)
    for parts in (1, 2):
        trained(store, tmp_path / str(parts), choice, microbatches=parts, image_noise=0.0)
        line = json.loads((tmp_path / str(parts) / "log.jsonl").read_text().splitlines()[0])
        found.append(line["target_l1_trunk"])
    assert found[1] == pytest.approx(found[0], rel=1e-4)


def test_a_policy_that_knows_no_targets_trains_on_data_that_have_them(store, tmp_path):
    assert fit(make_training(store, tmp_path, epochs=2))["steps"] > 0


def test_targets_that_are_not_there_are_asked_for():
    source = ShardSource(FakeStore([make_demonstration(0)]))
    with pytest.raises(ConfigError, match="policy 'act': it shall learn targets") as error:
        _require_targets(act(target_weight=1.0), source)
    assert "generate.targets" in error.value.hint
    _require_targets(act(), source)


def test_at_its_default_the_weight_does_not_enter_a_fingerprint():
    assert "target_weight" not in recipe_tree(ActConfig())
    assert recipe_tree(ActConfig(target_weight=0.5))["target_weight"] == 0.5
