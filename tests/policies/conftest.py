"""A tiny ACT and what it eats."""

import pytest
import torch

from geoprior.policies.act._network import ActNetwork
from geoprior.policies.act.plugin import ActConfig
from geoprior.policies.policy import Features

FEATURES = Features(cameras=("hand", "third"), image_size=(40, 64), hands=("hand",), chunk=5)
SIZES = {
    "dim": 16,
    "heads": 2,
    "ffn": 24,
    "encoder_layers": 2,
    "vae_layers": 1,
    "latent": 4,
    "trunk_width": 8,
}


@pytest.fixture
def make_act():
    def make(seed=0, features=FEATURES, **options):
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return ActNetwork(ActConfig(chunk=features.chunk, **{**SIZES, **options}), features)

    return make


@pytest.fixture
def make_batch():
    def make(size=3, seed=0, features=FEATURES):
        rng = torch.Generator().manual_seed(seed)
        shape = (size, len(features.cameras), 3, *features.image_size)
        return {
            "pose": torch.randn(size, features.pose_size, generator=rng),
            "images": torch.randn(shape, generator=rng),
            "action": torch.randn(size, features.chunk, features.pose_size, generator=rng),
            "valid": torch.arange(features.chunk) < torch.tensor([[features.chunk], [2], [1]])[:size],
        }

    return make
