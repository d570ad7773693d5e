"""Upright cones; stretched, they have elliptic bases."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import PrimitiveSpec, hookimpl
from geoprior.scene.solids import SolidOptions, sized_solid, unit_cone

if TYPE_CHECKING:
    import numpy as np

    from geoprior.scene.mesh import Mesh


@dataclass(frozen=True)
class Cone:
    """See `geoprior.hooks.types.Primitive`."""

    config: SolidOptions

    def sample(self, rng: np.random.Generator) -> Mesh:
        """Draw a cone."""
        return sized_solid(unit_cone(), self.config, rng)


@hookimpl
def geoprior_primitives() -> Iterable[PrimitiveSpec]:
    """One family."""
    yield PrimitiveSpec(name="cone", summary="upright cone", config=SolidOptions, factory=Cone)
