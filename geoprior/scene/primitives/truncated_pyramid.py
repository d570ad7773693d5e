"""Pyramids on slightly distorted polygons, cut off below their tips."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import PrimitiveSpec, hookimpl
from geoprior.scene.ranges import FractionRange, integer, uniform
from geoprior.scene.solids import PolygonOptions, frustum, polygon, sized_solid

if TYPE_CHECKING:
    import numpy as np

    from geoprior.scene.mesh import Mesh


class TruncatedPyramidConfig(PolygonOptions):
    """Base, size, cut and stretch."""

    top: FractionRange = Field((0.3, 0.8), description="Width of the top as a share of the base's.")


@dataclass(frozen=True)
class TruncatedPyramid:
    """See `geoprior.hooks.types.Primitive`."""

    config: TruncatedPyramidConfig

    def sample(self, rng: np.random.Generator) -> Mesh:
        """Draw a truncated pyramid."""
        sides, top = integer(rng, self.config.sides), uniform(rng, self.config.top)
        base = polygon(sides, self.config.distortion, rng)
        return sized_solid(frustum(base, top), self.config, rng, sides=sides, top=top)


@hookimpl
def geoprior_primitives() -> Iterable[PrimitiveSpec]:
    """One family."""
    yield PrimitiveSpec(
        name="truncated-pyramid",
        summary="pyramid of 3 to 8 sides without its tip",
        config=TruncatedPyramidConfig,
        factory=TruncatedPyramid,
    )
