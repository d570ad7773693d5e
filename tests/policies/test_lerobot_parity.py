"""Our ACT against what LeRobot's computes from the same weights and inputs: same outputs, losses, gradients.

The golden file is made by benchmarks/lerobot_parity.py in an environment of LeRobot's own.
"""

import json
import runpy
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open

from geoprior.errors import DataError
from geoprior.policies.act import _transformer
from geoprior.policies.act._network import ActNetwork
from geoprior.policies.act.lerobot_names import MODULES, OPTIONS, POSITION_TABLE, from_lerobot, to_lerobot
from geoprior.policies.act.plugin import ActConfig
from geoprior.policies.policy import Features
from geoprior.policies.predictor import to_commands
from geoprior.sim.ensembling import TemporalEnsemble

GOLDEN = Path(__file__).parent / "golden" / "lerobot_act.safetensors"
FORMULAS = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "parity_values.py"))
EXACT = {"atol": 1e-5, "rtol": 1e-5}


@cache
def values(formula, name, shape):
    return torch.from_numpy(FORMULAS[formula](name, shape))


@cache
def given():
    with safe_open(GOLDEN, "pt") as file:
        return json.loads(file.metadata()["parity"])


@dataclass(frozen=True)
class Case:
    """A case of the golden file: what LeRobot was given, and what it said."""

    config: ActConfig
    features: Features
    steps: list
    golden: dict

    def network(self, **options):
        config = self.config.model_copy(update={"dropout": 0.0, **options})
        act = ActNetwork(config, self.features)
        for name, tensor in act.state_dict().items():
            if not name.endswith("num_batches_tracked"):
                tensor.copy_(values("parameter_values", to_lerobot(name), tensor.shape))
        return act

    def batch(self):
        rows, features = len(self.steps), self.features
        shape = (rows, 3, *features.image_size)
        images = [values("uniform", f"observation.images.{camera}", shape) for camera in features.cameras]
        return {
            "pose": values("uniform", "observation.state", (rows, features.pose_size)),
            "images": torch.stack(images, dim=1),
            "action": values("uniform", "action", (rows, features.chunk, features.pose_size)),
            "valid": torch.arange(features.chunk) < torch.tensor(self.steps)[:, None],
        }

    def style(self):
        return values("uniform", "style", (len(self.steps), self.config.latent))


@pytest.fixture(params=["two_cameras", "deep", pytest.param("published", marks=pytest.mark.slow)])
def case(request):
    tree = given()["cases"][request.param]
    options = {ours: tree["config"][theirs] for ours, theirs in OPTIONS.items() if theirs in tree["config"]}
    lerobots = {"dim": 512, "ffn": 3200, "chunk": 100}  # where its defaults are not ours
    config = ActConfig(padding="all", trunk_norm="frozen", **(lerobots | options))
    hands = tuple(f"hand-{number}" for number in range(tree["pose_size"] // 8))
    features = Features(tuple(tree["cameras"]), tuple(tree["image_size"]), hands, config.chunk)
    with safe_open(GOLDEN, "pt") as file:
        keys = [key for key in file.keys() if key.startswith(f"{request.param}/")]  # noqa: SIM118
        golden = {key.partition("/")[2]: file.get_tensor(key) for key in keys}
    return Case(config, features, tree["steps"], golden)


@pytest.fixture
def given_style(monkeypatch, case):
    monkeypatch.setattr(torch, "randn_like", lambda _: case.style())


def learn(act, case):
    """As the golden file has it, from one pass in training mode."""
    batch = case.batch()
    total, scalars = act.loss(batch)
    mean, log_variance = act.encode_style(batch)
    actions = act.act(batch, mean + (0.5 * log_variance).exp() * case.style())
    losses = torch.stack([total, scalars["l1"], scalars["kl"]])
    return {"actions": actions, "mu": mean, "log_sigma_x2": log_variance, "losses": losses}


def test_the_chunk_at_a_style_of_zero(case):
    found = case.network().eval().predict(case.batch())
    torch.testing.assert_close(found, case.golden["predicted"], **EXACT)


def test_a_trained_batch_norm_predicts_as_lerobots_frozen_one(case):
    found = case.network(trunk_norm="batch").eval().predict(case.batch())
    torch.testing.assert_close(found, case.golden["predicted"], **EXACT)


@pytest.mark.usefixtures("given_style")
def test_actions_style_and_losses_of_a_training_step(case):
    for name, tensor in learn(case.network().train(), case).items():
        torch.testing.assert_close(
            tensor, case.golden[name], **EXACT, msg=lambda m, name=name: f"{name}: {m}"
        )


@pytest.mark.usefixtures("given_style")
def test_the_other_convention_of_padding_divides_by_valid_steps_only(case):
    """LeRobot 0.4.4 divides by all steps, padded ones too."""
    _, scalars = case.network(padding="valid").train().loss(case.batch())
    share = sum(case.steps) / (len(case.steps) * case.config.chunk)
    assert share < 0.9
    torch.testing.assert_close(scalars["l1"] * share, case.golden["losses"][1], **EXACT)


def test_gradients_of_the_loss(case, monkeypatch):
    """In float64: in float32, a ReLU that flips at zero can move the trunk's by half a percent."""
    act = case.network().double().train()
    batch = {name: x.double() if x.is_floating_point() else x for name, x in case.batch().items()}
    monkeypatch.setattr(torch, "randn_like", lambda _: case.style().double())
    act.loss(batch)[0].backward()
    named = {to_lerobot(name): parameter.grad for name, parameter in act.named_parameters()}
    rows = []
    for name, gradient in sorted(named.items()):
        direction = values("uniform", f"{name} direction", gradient.shape)
        rows.append([gradient.norm(), (gradient * direction).sum() / direction.norm()])
    expected = case.golden["gradients"]
    errors = (torch.tensor(rows) - expected).abs().amax(dim=1)
    scale = expected[:, 0] + 1e-6 * expected[:, 0].max()
    assert (errors / scale).max() < 1e-6


@pytest.mark.usefixtures("given_style")
def test_dropout_is_in_the_same_places(case, monkeypatch):
    """With a pattern in place of chance: a place that is missing, extra or moved changes the outputs."""

    def pattern(x, probability, training):
        assert training
        return x * (1.0 + probability * torch.cos(torch.arange(x.shape[-1], dtype=x.dtype)))

    monkeypatch.setattr(_transformer, "is_fusable", lambda *_: False)
    monkeypatch.setattr(_transformer.functional, "dropout", pattern)
    for name, tensor in learn(case.network(dropout=0.5).train(), case).items():
        torch.testing.assert_close(tensor, case.golden[f"dropped_{name}"], **EXACT)


def test_the_action_encoders_positions(case):
    torch.testing.assert_close(case.network().vae_position[:8], case.golden["vae_position"], **EXACT)


def test_initial_values_are_drawn_from_the_same_distributions(case):
    """Standard deviation within five of its own; the largest magnitude tells uniform from normal."""
    torch.manual_seed(1)
    act = ActNetwork(case.config, case.features)
    drawn = {to_lerobot(name): tensor for name, tensor in act.state_dict().items()}
    assert len(drawn) == len(case.golden["initial_spread"])
    for (name, tensor), (std, largest) in zip(
        sorted(drawn.items()), case.golden["initial_spread"], strict=True
    ):
        bound = 5.0 * std / tensor.numel() ** 0.5 + 1e-7
        assert (tensor.std(correction=0) - std).abs() < bound, name
        if tensor.numel() >= 1000:
            assert (tensor.abs().max() - largest).abs() <= 0.25 * largest, name


def test_temporal_ensembling():
    """Where quaternions lie in one hemisphere: LeRobot averages their numbers, whatever the signs."""
    setting, near = given()["ensemble"], np.float32([0, 0, 0, 0, 0, 0, 2, 0.5])
    with safe_open(GOLDEN, "np") as file:
        expected = to_commands(file.get_tensor("ensembled"))
    ensemble = TemporalEnsemble(setting["coefficient"])
    for step in range(setting["steps"]):
        ensemble.add(step, near + FORMULAS["uniform"](f"chunk {step}", (setting["chunk"], 8)))
        np.testing.assert_allclose(ensemble.command(step), expected[step], atol=1e-5)


def test_names_are_renamed_one_to_one_and_back(case):
    act = case.network()
    renamed = {to_lerobot(name): name for name in act.state_dict()}
    assert len(renamed) == len(act.state_dict())
    assert {name: from_lerobot(name) for name in renamed} == renamed
    assert {name.partition(".")[0] for name in act.state_dict()} == set(MODULES)


@pytest.mark.parametrize("name", ["encoders.layers.0.norm1.weight", "fc.weight", ""])
def test_foreign_names_are_refused(name):
    with pytest.raises(DataError, match="none of ACT's"):
        to_lerobot(name)
    with pytest.raises(DataError, match="none of ACT's"):
        from_lerobot(f"model.{name}")


def test_names_without_a_counterpart_are_refused():
    with pytest.raises(DataError, match="no counterpart"):
        to_lerobot("trunk.bn1.num_batches_tracked")
    with pytest.raises(DataError, match="none of ACT's"):
        from_lerobot(POSITION_TABLE)
    with pytest.raises(DataError, match="names begin with"):
        from_lerobot("action_head.weight")
