"""ACT (Zhao et al. 2023, arXiv:2304.13705) with the mathematics of LeRobot's implementation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from geoprior.policies.act._positions import sinusoid_1d, sinusoid_2d
from geoprior.policies.act._prediction import PackedAct
from geoprior.policies.act._targets import TargetHeads
from geoprior.policies.act._transformer import Decoder, Encoder
from geoprior.policies.fused._passes import arithmetic_of
from geoprior.policies.fused.kept import Kept, State, state_of
from geoprior.policies.fused.packed import is_packable
from geoprior.policies.trunk import STRIDE, ResNet18, camera_features

if TYPE_CHECKING:
    from collections.abc import Mapping

    from geoprior.policies.act.plugin import ActConfig
    from geoprior.policies.policy import Batch, Features, Observation


class ActNetwork(nn.Module):
    """Observations to action chunks, through a style variable that is zero at inference.

    Args:
        config: Sizes and weights of the loss.
        features: What the policy sees and says.
    """

    trunk_prefixes: tuple[str, ...] = ("trunk.",)
    training_only_prefixes: tuple[str, ...] = ("target_heads.",)
    half_weights = True
    image_position: Tensor
    vae_position: Tensor

    def __init__(self, config: ActConfig, features: Features) -> None:
        super().__init__()
        self.config = config
        self.features = features
        stack = (config.dim, config.heads, config.ffn, config.dropout)
        self.trunk = ResNet18(config.trunk_width, config.trunk_norm)
        self.image_proj = nn.Conv2d(self.trunk.channels, config.dim, 1)
        self.pose_proj = nn.Linear(features.pose_size, config.dim)
        self.latent_proj = nn.Linear(config.latent, config.dim)
        self.token_position = nn.Parameter(torch.randn(2, config.dim))
        self.encoder = Encoder(config.encoder_layers, *stack)
        self.decoder = Decoder(config.decoder_layers, *stack)
        self.query_position = nn.Parameter(torch.randn(features.chunk, config.dim))
        self.action_head = nn.Linear(config.dim, features.pose_size)

        self.vae_cls = nn.Parameter(torch.randn(1, config.dim))
        self.vae_pose_proj = nn.Linear(features.pose_size, config.dim)
        self.vae_action_proj = nn.Linear(features.pose_size, config.dim)
        self.vae_encoder = Encoder(config.vae_layers, *stack)
        self.vae_head = nn.Linear(config.dim, 2 * config.latent)

        rows, columns = (-(-size // STRIDE) for size in features.image_size)
        image_position = sinusoid_2d(rows, columns, config.dim).flatten(0, 1)
        self.register_buffer("image_position", image_position, persistent=False)
        vae_position = sinusoid_1d(2 + features.chunk, config.dim)
        self.register_buffer("vae_position", vae_position, persistent=False)
        for parameter in [*self.encoder.parameters(), *self.decoder.parameters()]:
            if parameter.dim() > 1:
                nn.init.xavier_uniform_(parameter)
        self.trunk.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._kept: Kept[PackedAct] = Kept()
        self.target_heads: TargetHeads | None = None
        if config.target_weight and features.targets:  # last, so that the other first weights stay
            seen = len(features.cameras) * rows * columns
            self.target_heads = TargetHeads(features.targets, config.dim, seen, seen + 2)

    def loss(self, batch: Batch) -> tuple[Tensor, Mapping[str, Tensor]]:
        """L1 of the chunk plus the weighted KL divergence of the style variable from a unit normal."""
        mean, log_variance = self.encode_style(batch)
        latent = mean + (0.5 * log_variance).exp() * torch.randn_like(mean)
        image_tokens, memory, position = self.encode(batch, latent)
        actions = self.decode(memory, position).float()
        error = (actions - batch["action"]).abs() * batch["valid"].unsqueeze(-1)
        terms = batch["valid"].sum() if self.config.padding == "valid" else batch["valid"].numel()
        l1 = error.sum() / (terms * error.shape[-1])
        kl = -0.5 * (1.0 + log_variance - mean.square() - log_variance.exp()).sum(dim=-1).mean()
        total = l1 + self.config.kl_weight * kl
        scalars = {"l1": l1, "kl": kl}
        if self.target_heads is not None and "targets" in batch:
            missed, missed_by = self.target_heads(image_tokens, memory, batch["targets"])
            total = total + self.config.target_weight * missed
            scalars |= missed_by
        return total, {name: value.detach() for name, value in {"loss": total, **scalars}.items()}

    def predict(self, observation: Observation) -> Tensor:
        """The chunk at a style of zero; see `geoprior.policies.policy.Policy`."""
        pose, images = observation["pose"], observation["images"]
        with torch.no_grad():
            state = state_of(self) if is_packable(images) and self.trunk.is_foldable() else None
            if state is not None:
                return self._predict_packed(observation, state)
            return self.act(observation, pose.new_zeros(pose.shape[0], self.config.latent)).float()

    def _predict_packed(self, observation: Observation, state: State) -> Tensor:
        pose, images = observation["pose"], observation["images"]
        size, dtype = images.shape, arithmetic_of(images)
        with torch.autocast("cpu", enabled=False):
            packed = self._kept.get((state, size, dtype), lambda: PackedAct(self, size, dtype))
            return packed(pose, images)

    def trunk_features(self, images: Tensor) -> Tensor:
        """(B, cameras, F) float32 of frames (B, cameras, 3, H, W); see `geoprior.policies.policy.Policy`."""
        return camera_features(self.trunk, images)

    def position(self, cameras: int) -> Tensor:
        """(tokens, dim): of the style, of the pose, and of every camera's image tokens."""
        return torch.cat([self.token_position, self.image_position.repeat(cameras, 1)])

    def encode_style(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Mean and logarithm of the variance of the style, each (B, latent) float32."""
        pose, action = batch["pose"], batch["action"]
        cls = self.vae_cls.expand(len(pose), 1, -1)
        tokens = [cls, self.vae_pose_proj(pose).unsqueeze(1), self.vae_action_proj(action)]
        valid = functional.pad(batch["valid"], (2, 0), value=True)
        dtype = tokens[1].dtype
        x = torch.cat([token.to(dtype) for token in tokens], dim=1)
        encoded = self.vae_encoder(x, self.vae_position.to(dtype), valid, wanted=1)[:, 0]
        mean, log_variance = self.vae_head(encoded).float().chunk(2, dim=-1)
        return mean, log_variance

    def act(self, observation: Observation, latent: Tensor) -> Tensor:
        """(B, chunk, pose_size) actions for a style (B, latent)."""
        _, memory, position = self.encode(observation, latent)
        return self.decode(memory, position)

    def encode(self, observation: Observation, latent: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """What the decoder looks at, and where it comes from.

        Returns:
            Image tokens (B, S, dim) as the trunk gives them, all tokens (B, 2 + S, dim) as the encoder gives
            them, and the positions (2 + S, dim) of those.
        """
        images = observation["images"]
        batch, cameras = images.shape[:2]
        maps = self.image_proj(self.trunk(images.flatten(0, 1)))
        dtype = maps.dtype
        image_tokens = maps.flatten(2).transpose(1, 2).reshape(batch, -1, maps.shape[1])
        tokens = [self.latent_proj(latent).unsqueeze(1), self.pose_proj(observation["pose"]).unsqueeze(1)]
        memory = torch.cat([*(token.to(dtype) for token in tokens), image_tokens], dim=1)
        position = self.position(cameras).to(dtype)
        return image_tokens, self.encoder(memory, position), position

    def decode(self, memory: Tensor, position: Tensor) -> Tensor:
        """(B, chunk, pose_size) actions for tokens and positions that `encode` gives."""
        query = self.query_position.to(memory.dtype)
        decoded = self.decoder(query.new_zeros(len(memory), *query.shape), query, memory, position)
        actions: Tensor = self.action_head(decoded)
        return actions
