"""Prisms on slightly distorted polygons; with four sides and a stretch, boxes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import PrimitiveSpec, hookimpl
from geoprior.scene.ranges import integer
from geoprior.scene.solids import PolygonOptions, frustum, polygon, sized_solid

if TYPE_CHECKING:
    import numpy as np

    from geoprior.scene.mesh import Mesh


@dataclass(frozen=True)
class Prism:
    """See `geoprior.hooks.types.Primitive`."""

    config: PolygonOptions

    def sample(self, rng: np.random.Generator) -> Mesh:
        """Draw a prism."""
        sides = integer(rng, self.config.sides)
        base = polygon(sides, self.config.distortion, rng)
        return sized_solid(frustum(base, 1.0), self.config, rng, sides=sides)


@hookimpl
def geoprior_primitives() -> Iterable[PrimitiveSpec]:
    """One family."""
    yield PrimitiveSpec(
        name="prism",
        summary="prism on a distorted polygon of 3 to 8 sides",
        config=PolygonOptions,
        factory=Prism,
    )
