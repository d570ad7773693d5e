"""The policy: a loss on noise at random levels, and sampling from one fixed start."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn
from torch.nn import functional

from geoprior_diffusion.average import Average
from geoprior_diffusion.network import DiffusionNetwork
from geoprior_diffusion.noise import Noise, start_noise

if TYPE_CHECKING:
    from collections.abc import Mapping

    from geoprior.policies.policy import Batch, Features, Observation
    from geoprior_diffusion.plugin import DiffusionConfig


class DiffusionPolicy(nn.Module):
    """See `geoprior.policies.policy.Policy`.

    What learns is `network`; what acts, and what held-out episodes judge, is its moving `average`.

    Args:
        config: Sizes and noise.
        features: What the policy sees and says.
    """

    trunk_prefixes: tuple[str, ...] = ("network.trunk.",)
    half_weights = True

    def __init__(self, config: DiffusionConfig, features: Features) -> None:
        super().__init__()
        self.config = config
        self.features = features
        self.network = DiffusionNetwork(config, features)
        self.average = Average(self.network, config.average)
        self._noise = Noise(config)
        self._start = start_noise(config.horizon, features.pose_size)

    def loss(self, batch: Batch) -> tuple[Tensor, Mapping[str, Tensor]]:
        """Mean squared error of what the network says at random noise levels, over valid actions.

        The scalar ``l1`` is the error of the clean actions that it implies at those levels. It is no forecast
        of the robot's error: at low levels the noisy actions give the answer away. In evaluation mode
        ``sampled_l1`` is that error: of the actions that `predict` gives, as ACT's ``l1`` is.
        """
        if self.training:
            self.average.follow(self.network)
        network = self.network if self.training else self.average.network
        seen = network.observe(batch).repeat_interleave(self.config.draws, 0)
        actions, valid = (rows.repeat_interleave(self.config.draws, 0) for rows in self._held(batch))
        noise = torch.randn_like(actions)
        levels = torch.randint(self._noise.levels, (len(actions),), device=actions.device)
        noisy = self._noise.hide(actions, noise, levels)
        said = network(noisy, levels, seen)
        loss = _mean((said - self._noise.target(actions, noise, levels)).square(), valid)
        l1 = _mean((self._noise.reveal(noisy, said, levels) - actions).abs(), valid)
        scalars = {"loss": loss, "l1": l1}
        if not self.training:
            scalars["sampled_l1"] = _mean((self.predict(batch) - batch["action"]).abs(), batch["valid"])
        return loss, {name: value.detach() for name, value in scalars.items()}

    def predict(self, observation: Observation) -> Tensor:
        """The chunk that DDIM finds from one fixed start; see `geoprior.policies.policy.Policy`.

        Every row of every batch starts from the same noise. So a prediction depends on its own observation
        only, and successive chunks of a rollout follow the same mode where there are several.
        """
        network = self.average.network
        with torch.no_grad():
            seen = network.observe(observation)
            start = self._start.to(seen.device).expand(len(seen), -1, -1)
            actions = self._noise.denoise(start, lambda noisy, levels: network(noisy, levels, seen))
        return actions[:, : self.features.chunk]

    def _held(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Actions (B, horizon, pose_size), the last valid one held to the end, and which are valid.

        The convolutions carry what stands in the padding into what is learned, so it must not be arbitrary.
        """
        more = self.config.horizon - self.features.chunk
        actions = functional.pad(batch["action"], (0, 0, 0, more))
        valid = functional.pad(batch["valid"], (0, more), value=False)
        steps = torch.arange(self.config.horizon, device=valid.device)
        last = torch.where(valid, steps, 0).cummax(dim=1).values
        return actions.gather(1, last.unsqueeze(-1).expand_as(actions)), valid


def _mean(errors: Tensor, valid: Tensor) -> Tensor:
    """Of errors (B, T, C) over valid (B, T) actions."""
    return (errors * valid.unsqueeze(-1)).sum() / (valid.sum() * errors.shape[-1])
