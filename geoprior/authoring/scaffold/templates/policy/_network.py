"""The network: one trunk for all cameras, then pose and pictures together to the actions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

if TYPE_CHECKING:
    from geoprior.authoring.scaffold.templates.policy import MyPluginConfig
    from geoprior.policies.policy import Batch, Features, Observation

SQUARES = 4
"""The trunk's last map is averaged to so many squares along each side."""


class MyPluginNetwork(nn.Module):
    """See `geoprior.policies.policy.Policy`: normalised numbers in, normalised numbers out.

    Args:
        config: Its options.
        features: Cameras, size of the pictures, of the pose, and of the chunk.
    """

    trunk_prefixes: tuple[str, ...] = ("trunk.",)

    def __init__(self, config: MyPluginConfig, features: Features) -> None:
        super().__init__()
        self.features = features
        width = config.width
        self.trunk = nn.Sequential(
            nn.Conv2d(3, width // 2, 5, stride=2, padding=2),
            nn.ReLU(),
            nn.Conv2d(width // 2, width, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Conv2d(width, width, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.AdaptiveAvgPool2d(SQUARES),
        )
        seen = len(features.cameras) * width * SQUARES**2 + features.pose_size
        self.head = nn.Sequential(
            nn.Linear(seen, config.hidden),
            nn.ReLU(),
            nn.Linear(config.hidden, features.chunk * features.pose_size),
        )

    def forward(self, observation: Observation) -> Tensor:
        """(B, chunk, pose_size) normalised actions."""
        images, pose = observation["images"], observation["pose"]
        seen = self.trunk(images.flatten(0, 1)).reshape(len(pose), -1)
        actions: Tensor = self.head(torch.cat([seen, pose], dim=1))
        return actions.reshape(len(pose), self.features.chunk, self.features.pose_size)

    def loss(self, batch: Batch) -> tuple[Tensor, Mapping[str, Tensor]]:
        """The mean absolute error over the actions that are no padding."""
        errors = (self(batch) - batch["action"]).abs().mean(dim=2)
        valid = batch["valid"].to(errors.dtype)
        l1 = (errors * valid).sum() / valid.sum().clamp(min=1.0)
        return l1, {"l1": l1.detach()}

    @torch.no_grad()
    def predict(self, observation: Observation) -> Tensor:
        """(B, chunk, pose_size) actions, without gradients or randomness."""
        actions: Tensor = self(observation)
        return actions
