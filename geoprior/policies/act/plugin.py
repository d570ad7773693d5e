"""ACT's options and its registration."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal, Self

from pydantic import Field, model_validator

from geoprior import PolicySpec, hookimpl
from geoprior.policies.policy import PolicyOptions, TrunkNorm

if TYPE_CHECKING:
    from geoprior.policies.act._network import ActNetwork
    from geoprior.policies.policy import Features


class ActConfig(PolicyOptions):
    """Sizes and losses of ACT; the packaged config `compact` has sizes for two cores."""

    later = PolicyOptions.later | {"target_weight"}

    dim: int = Field(256, ge=8, le=4096, multiple_of=4, description="Width of every token.")
    heads: int = Field(8, ge=1, le=64, description="Attention heads; they divide `dim`.")
    ffn: int = Field(1024, ge=1, le=16384, description="Hidden width of the feed-forward layers.")
    encoder_layers: int = Field(4, ge=1, le=24, description="Layers of the observation encoder.")
    decoder_layers: int = Field(1, ge=1, le=24, description="Layers of the action decoder.")
    vae_layers: int = Field(
        4, ge=1, le=24, description="Layers of the action encoder, used in training only."
    )
    latent: int = Field(32, ge=1, le=1024, description="Size of the style variable.")
    dropout: float = Field(0.1, ge=0.0, le=0.95, description="Dropout in all transformer layers.")
    kl_weight: float = Field(10.0, ge=0.0, description="Weight of the KL divergence in the loss.")
    padding: Literal["valid", "all"] = Field(
        "valid",
        description="The L1 loss is averaged over `valid` actions only, or over `all` with padded ones as 0.",
    )
    target_weight: float = Field(
        0.0,
        ge=0.0,
        le=1000.0,
        description="Weight of the targets that `generate.targets` adds to the data, in the loss of "
        "pretraining; the heads that learn them are thrown away afterwards, and 0 has none.",
    )
    trunk_width: int = Field(
        64, ge=8, le=256, multiple_of=8, description="64 is ResNet-18; 32 has half of it."
    )
    trunk_norm: TrunkNorm = Field(
        "batch",
        description="`batch`: trainable batch norm; `frozen`: it stays as it is; `group`: group norm.",
    )

    @property
    def uses_targets(self) -> bool:
        """See `PolicyOptions.uses_targets`."""
        return self.target_weight > 0.0

    @model_validator(mode="after")
    def _heads_divide_dim(self) -> Self:
        if self.dim % self.heads:
            raise ValueError(f"heads {self.heads} must divide dim {self.dim}")
        return self


def _build(config: ActConfig, features: Features) -> ActNetwork:
    from geoprior.policies.act._network import ActNetwork

    return ActNetwork(config, features)


@hookimpl
def geoprior_policies() -> Iterable[PolicySpec]:
    """The policy of the paper."""
    yield PolicySpec(
        name="act",
        summary="action chunking with transformers: ResNet-18 trunk, transformer, conditional VAE",
        config=ActConfig,
        factory=_build,
    )
