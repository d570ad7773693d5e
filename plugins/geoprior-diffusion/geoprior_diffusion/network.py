"""What learns: observations and noisy actions in, and out what the config's ``prediction`` says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from diffusers.models.embeddings import TimestepEmbedding, Timesteps
from torch import Tensor, nn

from geoprior.policies.trunk import ResNet18
from geoprior_diffusion.unet import ConditionalUnet

if TYPE_CHECKING:
    from geoprior.policies.policy import Features, Observation
    from geoprior_diffusion.plugin import DiffusionConfig


class Keypoints(nn.Module):
    """Spatial softmax (Finn et al. 2016): where in the frame each learned feature is, on average.

    How strong the feature is there is told as well: of the small frames that the trunk brings down to a cell
    or two, places alone say little or nothing.

    Args:
        inputs: Channels of the feature map.
        count: Features, and so points.
    """

    def __init__(self, inputs: int, count: int) -> None:
        super().__init__()
        self.size = 3 * count
        self.maps = nn.Conv2d(inputs, count, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) to (B, size): x and y from -1 to 1 over the frame, and strengths."""
        maps: Tensor = self.maps(x).float()
        height, width = maps.shape[-2:]
        weights = maps.flatten(2).softmax(dim=-1).view(maps.shape)
        across = weights.sum(dim=2) @ torch.linspace(-1.0, 1.0, width, device=x.device)
        along = weights.sum(dim=3) @ torch.linspace(-1.0, 1.0, height, device=x.device)
        return torch.cat([across, along, (weights * maps).sum(dim=(2, 3))], dim=1)


class DiffusionNetwork(nn.Module):
    """Trunk, keypoints and U-Net.

    Args:
        config: Sizes.
        features: What the policy sees and says.
    """

    def __init__(self, config: DiffusionConfig, features: Features) -> None:
        super().__init__()
        size = config.level_features
        self.trunk = ResNet18(config.trunk_width, config.trunk_norm)
        self.keypoints = Keypoints(self.trunk.channels, config.keypoints)
        self.sinusoids = Timesteps(size, flip_sin_to_cos=False, downscale_freq_shift=1)
        self.level = TimestepEmbedding(size, 4 * size, act_fn="mish", out_dim=size)
        seen = features.pose_size + self.keypoints.size * len(features.cameras)
        self.unet = ConditionalUnet(features.pose_size, seen + size, config.widths, config.kernel)
        self.trunk.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def observe(self, observation: Observation) -> Tensor:
        """(B, pose_size + 3 keypoints x cameras) what the observation says to the U-Net."""
        images = observation["images"]
        points = self.keypoints(self.trunk(images.flatten(0, 1)))
        return torch.cat([observation["pose"], points.view(len(images), -1)], dim=1)

    def forward(self, noisy: Tensor, levels: Tensor, seen: Tensor) -> Tensor:
        """What the network says of noisy actions.

        Args:
            noisy: (B, horizon, pose_size).
            levels: (B,) int64, noise levels.
            seen: (B, S); see `observe`.

        Returns:
            (B, horizon, pose_size) float32.
        """
        condition = torch.cat([self.level(self.sinusoids(levels)), seen], dim=1)
        said: Tensor = self.unet(noisy, condition)
        return said.float()
