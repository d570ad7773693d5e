"""The noise: levels, what is learned of it, and the way back, on top of diffusers' DDIM scheduler."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import torch
from diffusers import DDIMScheduler
from torch import Tensor

if TYPE_CHECKING:
    from geoprior_diffusion.plugin import DiffusionConfig

_START_SEED = 0


class Noise:
    """How actions are hidden in noise and found again.

    Args:
        config: Levels, steps, and what the network predicts.
    """

    def __init__(self, config: DiffusionConfig) -> None:
        self.levels = config.train_steps
        self._prediction = config.prediction
        self._clip = config.clip
        ddim: Any = DDIMScheduler  # its own types are partial
        self._scheduler = ddim(
            num_train_timesteps=config.train_steps,
            beta_schedule="squaredcos_cap_v2",
            prediction_type=config.prediction,
            clip_sample=True,
            clip_sample_range=config.clip,
        )
        self._scheduler.set_timesteps(config.inference_steps)

    def hide(self, actions: Tensor, noise: Tensor, levels: Tensor) -> Tensor:
        """Noisy actions (B, T, C) at levels (B,)."""
        return cast("Tensor", self._scheduler.add_noise(actions, noise, levels))

    def target(self, actions: Tensor, noise: Tensor, levels: Tensor) -> Tensor:
        """(B, T, C) what the network shall say."""
        if self._prediction == "v_prediction":
            return cast("Tensor", self._scheduler.get_velocity(actions, noise, levels))
        return noise if self._prediction == "epsilon" else actions

    def reveal(self, noisy: Tensor, said: Tensor, levels: Tensor) -> Tensor:
        """The clean actions (B, T, C) that the network's words imply at levels (B,), within ``clip``."""
        kept = self._scheduler.alphas_cumprod.to(noisy.device)[levels][:, None, None]
        signal, spread = kept.sqrt(), (1.0 - kept).sqrt()
        clean: Tensor = {
            "epsilon": (noisy - spread * said) / signal,
            "sample": said,
            "v_prediction": signal * noisy - spread * said,
        }[self._prediction]
        return clean.clamp(-self._clip, self._clip)

    def denoise(self, start: Tensor, network: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
        """Go from noise to actions by DDIM without fresh noise (eta = 0).

        Args:
            start: (B, T, C).
            network: From noisy actions and levels (B,) to what it says of them.
        """
        x = start
        for level in self._scheduler.timesteps.tolist():
            said = network(x, torch.full((len(x),), level, device=x.device))
            x = self._scheduler.step(said, level, x, eta=0.0).prev_sample
        return x


def start_noise(horizon: int, channels: int) -> Tensor:
    """(1, horizon, channels) the same on every machine and in every call."""
    seeded = torch.Generator().manual_seed(_START_SEED)
    return torch.randn(1, horizon, channels, generator=seeded)
