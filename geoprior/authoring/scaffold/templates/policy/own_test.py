"""What is special about this policy."""

from __future__ import annotations

import torch

from geoprior.authoring.scaffold.templates.policy import MyPluginConfig, build
from geoprior.policies.policy import Features


def test_actions_that_are_padding_do_not_count() -> None:
    features = Features(("hand", "third"), (32, 32), ("hand",), 5)
    policy = build(MyPluginConfig(chunk=5), features)
    pose, images = torch.zeros(2, 8), torch.zeros(2, 2, 3, 32, 32)
    action, valid = torch.zeros(2, 5, 8), torch.ones(2, 5, dtype=torch.bool)
    valid[1, 3:] = False
    before, _ = policy.loss({"pose": pose, "images": images, "action": action, "valid": valid})
    action[1, 3:] = 100.0
    after, _ = policy.loss({"pose": pose, "images": images, "action": action, "valid": valid})
    assert torch.equal(before, after)
