"""A predictor as one torch module, raw observations in and commands out: what an export makes a graph of."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
import torch
from torch import Tensor, nn

from geoprior.episode import POSE_SIZE
from geoprior.policies.normalise import NORMALISED_FEATURES, STD_FLOOR, normalise_images, origins

if TYPE_CHECKING:
    from geoprior.policies.normalise import Normaliser
    from geoprior.policies.policy import Policy


class DeployedPolicy(nn.Module):
    """The arithmetic of `geoprior.policies.predictor.LoadedPredictor`, in torch and in its precisions.

    Args:
        policy: A `geoprior.policies.policy.Policy`; it is put into evaluation mode.
        normaliser: With the checkpoint's statistics.
    """

    pose_mean: Tensor
    pose_std: Tensor
    action_mean: Tensor
    action_std: Tensor
    counted: Tensor

    def __init__(self, policy: nn.Module, normaliser: Normaliser) -> None:
        super().__init__()
        self.policy = policy.eval()
        for name in NORMALISED_FEATURES:
            feature = normaliser.statistics[name]
            self.register_buffer(f"{name}_mean", torch.tensor(feature.mean, dtype=torch.float64))
            std = torch.tensor(feature.std, dtype=torch.float64).clamp_min(STD_FLOOR)
            self.register_buffer(f"{name}_std", std)
        self._is_relative = normaliser.actions == "relative"
        if self._is_relative:
            ones = np.ones(len(normaliser.statistics["pose"].mean), np.float32)
            self.register_buffer("counted", torch.from_numpy(origins(ones, normaliser.actions)))

    def forward(self, pose: Tensor, *frames: Tensor) -> Tensor:
        """One chunk of commands for each of B observations.

        Args:
            pose: (B, pose_size) float32.
            frames: For each camera, in the order of `Features`, (B, H, W, 3) uint8.

        Returns:
            (B, chunk, pose_size) float32; see `geoprior.policies.policy.Predictor.predict`.
        """
        return commands(self.act(pose, *frames))

    def act(self, pose: Tensor, *frames: Tensor) -> Tensor:
        """The same as `forward`, but as the policy says it: quaternions and grippers are any numbers."""
        normalised = ((pose.double() - self.pose_mean) / self.pose_std).float()
        images = normalise_images(torch.stack(frames, dim=1))
        actions = cast("Policy", self.policy).predict({"pose": normalised, "images": images})
        said = actions.double() * self.action_std + self.action_mean
        if self._is_relative:
            said = said + torch.where(self.counted > 0.0, pose.double().unsqueeze(1), 0.0)
        return said.float()


def commands(actions: Tensor) -> Tensor:
    """See `geoprior.policies.predictor.to_commands`: the same in torch."""
    by_hand = actions.reshape(*actions.shape[:-1], -1, POSE_SIZE).double()
    quaternions = by_hand[..., 3:7]
    norms = quaternions.square().sum(dim=-1, keepdim=True).sqrt()
    closed = (by_hand[..., 7:] > 0.5).double()
    parts = [by_hand[..., :3], quaternions / norms.clamp_min(1e-9), closed]
    made = torch.cat(parts, dim=-1).flatten(-2).float()
    return torch.where(torch.isfinite(actions).all(dim=-1, keepdim=True), made, torch.nan)
