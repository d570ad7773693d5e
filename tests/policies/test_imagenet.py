"""ImageNet's weights: torchvision is faked, for it does not import beside the CPU build of torch."""

import sys
from types import ModuleType, SimpleNamespace

import pytest
import torch
from torch import nn

from geoprior.errors import ConfigError, DataError, MachineError
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.imagenet import load_imagenet_trunk
from geoprior.policies.policy import Features
from geoprior.policies.trunk import ResNet18
from geoprior.training.config import ConditionConfig

FEATURES = Features(("hand", "third"), (32, 32), ("hand",), 4)
SMALL = {"dim": 16, "heads": 2, "ffn": 16, "encoder_layers": 1, "vae_layers": 1, "latent": 4, "chunk": 4}


class Published(ResNet18):
    """Stands in for torchvision's network: its names and shapes, classifier and counters included."""

    def __init__(self):
        super().__init__(64, "batch")
        self.fc = nn.Linear(512, 1000)


@pytest.fixture
def published(monkeypatch):
    torch.manual_seed(7)
    network = Published()
    module = ModuleType("torchvision")
    module.models = SimpleNamespace(
        resnet18=lambda weights: {"v1": network}[weights],
        ResNet18_Weights=SimpleNamespace(IMAGENET1K_V1="v1"),
    )
    monkeypatch.setitem(sys.modules, "torchvision", module)
    return network.state_dict()


def build(**options):
    torch.manual_seed(0)
    return plugins().build("policy", Choice(name="act", options={**SMALL, **options}), FEATURES)


@pytest.mark.parametrize("norm", ["batch", "frozen"])
def test_the_trunk_is_the_published_one_and_the_rest_stays(published, norm):
    policy, before = build(trunk_norm=norm), build(trunk_norm=norm).state_dict()
    names = load_imagenet_trunk(policy, "act")
    assert len(names) == (120 if norm == "batch" else 100)
    for name, tensor in policy.state_dict().items():
        expected = published[name.removeprefix("trunk.")] if name in names else before[name]
        assert torch.equal(tensor, expected), name
    assert all(name.startswith("trunk.") for name in names)


@pytest.mark.parametrize("options", [{"trunk_width": 32}, {"trunk_norm": "group"}])
def test_another_trunk_is_refused_by_name(published, options):
    with pytest.raises(DataError, match=r"the published ResNet-18: .*'trunk\.") as error:
        load_imagenet_trunk(build(**options), "act")
    assert "trunk_width 64" in error.value.hint


def test_a_policy_without_a_trunk_is_refused(published):
    policy = nn.Linear(2, 2)
    policy.trunk_prefixes = ()
    with pytest.raises(ConfigError, match="policy 'linear' names 0 trunks"):
        load_imagenet_trunk(policy, "linear")


def test_without_torchvision_the_machine_is_to_blame(monkeypatch):
    monkeypatch.setitem(sys.modules, "torchvision", None)
    with pytest.raises(MachineError, match=r"come from torchvision, which does not import"):
        load_imagenet_trunk(build(), "act")


def test_without_a_network_too(published, monkeypatch):
    def offline(weights):
        raise OSError("no route to host")

    monkeypatch.setattr(sys.modules["torchvision"].models, "resnet18", offline)
    with pytest.raises(MachineError, match=r"could not get its weights \(no route to host\)"):
        load_imagenet_trunk(build(), "act")


def test_weights_come_from_imagenet_alone_and_statistics_may_be_a_priors():
    assert ConditionConfig(init="imagenet").weights == "all"
    assert ConditionConfig(init="imagenet", statistics="pretrained").takes_from_a_prior
    with pytest.raises(ValueError, match="init 'imagenet' has no prior"):
        ConditionConfig(init="imagenet", weights="trunk")
