"""Another lamp: from any side, brighter or darker, warmer or colder."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import LookSpec, hookimpl
from geoprior.options import Options

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

    import mujoco

STEEPNESS = np.radians([30.0, 70.0])
"""Range of the lamp's height over the horizon."""


class OtherLightConfig(Options):
    """Options of the look `other-light`."""

    brightness: float = Field(
        0.5, ge=0.0, le=0.9, description="All light is multiplied by 1 - this up to 1 + this."
    )
    tint: float = Field(
        0.25, ge=0.0, le=0.9, description="Red is raised by up to this and blue lowered, or the reverse."
    )


@dataclass(frozen=True)
class OtherLight:
    """See `geoprior.sim.looks.look.Look`."""

    config: OtherLightConfig

    def furnish(self, world: ET.Element) -> None:
        """Nothing is added."""

    def dress(self, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator) -> None:  # noqa: ARG002
        """Turn the lamp to another side and give all light another strength and colour."""
        azimuth, height = rng.uniform(-np.pi, np.pi), rng.uniform(*STEEPNESS)
        towards_lamp = [np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)]
        model.light_dir[:] = -np.array(towards_lamp)
        brightness = 1.0 + rng.uniform(-self.config.brightness, self.config.brightness)
        warmth = rng.uniform(-self.config.tint, self.config.tint)
        colour = brightness * np.array([1.0 + warmth, 1.0, 1.0 - warmth])
        model.light_diffuse[:] *= colour
        model.vis.headlight.ambient[:] *= colour
        model.vis.headlight.diffuse[:] *= colour


@hookimpl
def geoprior_looks() -> Iterable[LookSpec]:
    """One look."""
    yield LookSpec(
        name="other-light",
        summary="the lamp shines from any side, with another strength and colour in every episode",
        config=OtherLightConfig,
        factory=OtherLight,
    )
