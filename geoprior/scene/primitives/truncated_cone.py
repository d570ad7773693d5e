"""Cones cut off below their tips; stretched, they have elliptic bases."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import PrimitiveSpec, hookimpl
from geoprior.scene.ranges import FractionRange, uniform
from geoprior.scene.solids import SolidOptions, circle, frustum, sized_solid

if TYPE_CHECKING:
    import numpy as np

    from geoprior.scene.mesh import Mesh


class TruncatedConeConfig(SolidOptions):
    """Size, cut and stretch."""

    top: FractionRange = Field((0.3, 0.8), description="Diameter of the top as a share of the base's.")


@dataclass(frozen=True)
class TruncatedCone:
    """See `geoprior.hooks.types.Primitive`."""

    config: TruncatedConeConfig

    def sample(self, rng: np.random.Generator) -> Mesh:
        """Draw a truncated cone."""
        top = uniform(rng, self.config.top)
        return sized_solid(frustum(circle(), top), self.config, rng, top=top)


@hookimpl
def geoprior_primitives() -> Iterable[PrimitiveSpec]:
    """One family."""
    yield PrimitiveSpec(
        name="truncated-cone",
        summary="cone without its tip",
        config=TruncatedConeConfig,
        factory=TruncatedCone,
    )
