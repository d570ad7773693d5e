"""The options of the diffusion policy, and its registration. Light: no torch, no diffusers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, model_validator

from geoprior import PolicySpec, hookimpl
from geoprior.policies.policy import PolicyOptions

if TYPE_CHECKING:
    from geoprior.policies.policy import Features
    from geoprior_diffusion.policy import DiffusionPolicy

Prediction = Literal["epsilon", "sample", "v_prediction"]
Width = Annotated[int, Field(ge=8, le=4096, multiple_of=8)]


class DiffusionConfig(PolicyOptions):
    """Sizes and noise of the diffusion policy. A chunk may be of any length; see `horizon`."""

    widths: tuple[Width, ...] = Field(
        (64, 128, 256),
        min_length=1,
        max_length=6,
        description="Channels of the U-Net at each of its time scales, each half as fine as the one before.",
    )
    kernel: int = Field(5, ge=1, le=15, description="Steps that a convolution in time spans; odd.")
    keypoints: int = Field(
        32, ge=1, le=1024, description="Points that each camera's feature map comes down to."
    )
    level_features: int = Field(
        64, ge=8, le=1024, multiple_of=2, description="Length of the embedding of the noise level."
    )
    train_steps: int = Field(
        100, ge=2, le=10_000, description="Noise levels, on the squared-cosine schedule."
    )
    inference_steps: int = Field(
        10, ge=1, le=10_000, description="Steps of DDIM from noise to actions; at most `train_steps`."
    )
    prediction: Prediction = Field(
        "sample",
        description="What the U-Net says: noise (`epsilon`), clean actions (`sample`), or their velocity.",
    )
    draws: int = Field(
        4,
        ge=1,
        le=256,
        description="Noise levels at which a sample is learned in one step; the trunk sees the sample once.",
    )
    clip: float = Field(
        10.0,
        gt=0.0,
        le=1e6,
        description="Clean actions are kept within so many standard deviations of the mean.",
    )
    average: float = Field(
        0.98,
        ge=0.0,
        lt=1.0,
        description="Decay of the moving average of the weights; it is what acts. 0: the last weights act.",
    )
    trunk_width: int = Field(
        64, ge=8, le=256, multiple_of=8, description="64 is ResNet-18; 32 has half of it."
    )
    trunk_norm: Literal["batch", "frozen", "group"] = Field(
        "group", description="`group`: group norm, as Chi et al.; `batch` and `frozen`: as in `act`."
    )

    @property
    def horizon(self) -> int:
        """Steps that the U-Net sees: the chunk, and padding up to a multiple of its coarsest stride."""
        stride = 2 ** (len(self.widths) - 1)
        return int(-(-self.chunk // stride) * stride)

    @model_validator(mode="after")
    def _steps_fit(self) -> Self:
        if self.inference_steps > self.train_steps:
            raise ValueError(f"inference_steps {self.inference_steps} exceeds train_steps {self.train_steps}")
        if self.kernel % 2 == 0:
            raise ValueError(f"kernel {self.kernel} must be odd, so that a convolution keeps the length")
        return self


def _build(config: DiffusionConfig, features: Features) -> DiffusionPolicy:
    from geoprior_diffusion.policy import DiffusionPolicy

    return DiffusionPolicy(config, features)


@hookimpl
def geoprior_policies() -> Iterable[PolicySpec]:
    """One policy."""
    yield PolicySpec(
        name="diffusion",
        summary="diffusion policy: ResNet-18 trunk, conditional U-Net in time, DDIM sampling",
        config=DiffusionConfig,
        factory=_build,
    )
