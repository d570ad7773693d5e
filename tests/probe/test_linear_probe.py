import numpy as np
import pytest
import torch
from probe_material import HERE, Blind, Looking, features, normaliser_of, square_episodes

from geoprior.options import Choice
from geoprior.policies.policy import Features
from geoprior.probe.linear import errors_cm, probe_episodes
from geoprior.probe.vision import VisionProbe
from geoprior.training.stages import build_policy


def test_a_camera_whose_features_tell_the_place_reads_it_and_the_other_does_not():
    rng = np.random.default_rng(0)
    places = {name: rng.uniform(-0.2, 0.2, (150, 2)) for name in ("hand", "third")}
    mix, noise = rng.normal(size=(2, 20)), rng.normal(size=(150, 20))
    episodes = np.repeat(np.arange(50), 3)
    for camera, name in enumerate(places):
        told = [noise, noise]
        told[camera] = places[name] @ mix + 3.0
        found = errors_cm(np.stack(told, axis=1), places, episodes)
        other = ({*places} - {name}).pop()
        assert found[name] < 0.5
        assert found[other] > 10.0


def test_a_policy_that_looks_is_read_and_one_without_features_is_not():
    episodes = square_episodes(30)
    probe = VisionProbe(episodes, features(episodes), normaliser_of(episodes))
    found = probe_episodes(Looking(normaliser_of(episodes)), probe, HERE)
    assert found is not None
    assert found["third"] < 1.0  # of a table of one metre
    assert probe_episodes(Blind(normaliser_of(episodes)), probe, HERE) is None


@pytest.mark.parametrize("norm", ["batch", "group"])
def test_act_gives_features_of_every_camera(norm):
    options = {"chunk": 4, "dim": 16, "heads": 2, "ffn": 16, "encoder_layers": 1, "vae_layers": 1}
    choice = Choice(name="act", options={**options, "latent": 4, "trunk_width": 8, "trunk_norm": norm})
    wide = Features(("hand", "third"), (32, 320), ("hand",), 4)
    policy = build_policy(choice, wide, 0).eval()
    images = torch.randn(3, 2, 3, 32, 320, generator=torch.Generator().manual_seed(0))
    found = policy.trunk_features(images)
    assert found.shape == (3, 2, 64 * 1 * 4)
    assert not found.requires_grad
    swapped = policy.trunk_features(images.flip(1))
    torch.testing.assert_close(swapped.flip(1), found, rtol=1e-4, atol=1e-4)
