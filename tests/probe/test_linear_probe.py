import numpy as np
import pytest
import torch
from probe_material import FEATURES, HERE, Blind, Looking, features, normaliser_of, square_episodes
from scipy.spatial.transform import Rotation

from geoprior.options import Choice
from geoprior.policies.policy import Features
from geoprior.probe.linear import errors_cm, probe_episodes
from geoprior.probe.vision import VisionProbe
from geoprior.training.stages import build_policy


def poses(count, rng):
    rotations = Rotation.random(count, random_state=1).as_quat()
    positions = rng.uniform(-0.2, 0.2, (count, 3))
    return np.column_stack([positions, rotations, np.zeros(count)]).astype(np.float32)


def in_hand(pose, objects):
    turned = Rotation.from_quat(pose[:, 3:7]).inv()
    return turned.apply(objects - pose[:, :3])


def test_a_camera_whose_features_tell_the_place_reads_it_and_the_other_does_not():
    rng = np.random.default_rng(0)
    pose, objects = poses(150, rng), rng.uniform(-0.2, 0.2, (150, 3))
    mix = rng.normal(size=(2, 20))
    noise = rng.normal(size=(150, 20))
    episodes = np.repeat(np.arange(50), 3)
    third = np.stack([noise, objects[:, :2] @ mix], axis=1)
    found = errors_cm(third, pose, objects, episodes, FEATURES)
    assert found["third"] < 0.5
    assert found["hand"] > 10.0
    hand = np.stack([in_hand(pose, objects)[:, :2] @ mix, noise], axis=1)
    found = errors_cm(hand, pose, objects, episodes, FEATURES)
    assert found["hand"] < 0.5
    assert found["third"] > 10.0


def test_of_several_hands_each_camera_has_its_own():
    rng = np.random.default_rng(0)
    left, right = poses(90, rng), poses(90, rng)[::-1]
    objects = rng.uniform(-0.2, 0.2, (90, 3))
    two = Features(("left", "right"), (32, 32), ("left", "right"), 4)
    pose = np.hstack([left, right])
    trunk = np.stack([in_hand(left, objects), in_hand(right, objects)], axis=1)
    found = errors_cm(trunk, pose, objects, np.arange(90), two)
    assert max(found.values()) < 0.5


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
