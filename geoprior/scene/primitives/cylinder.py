"""Upright cylinders; stretched, they have elliptic bases."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import PrimitiveSpec, hookimpl
from geoprior.scene.solids import SolidOptions, sized_solid, unit_cylinder

if TYPE_CHECKING:
    import numpy as np

    from geoprior.scene.mesh import Mesh


@dataclass(frozen=True)
class Cylinder:
    """See `geoprior.hooks.types.Primitive`."""

    config: SolidOptions

    def sample(self, rng: np.random.Generator) -> Mesh:
        """Draw a cylinder."""
        return sized_solid(unit_cylinder(), self.config, rng)


@hookimpl
def geoprior_primitives() -> Iterable[PrimitiveSpec]:
    """One family."""
    yield PrimitiveSpec(name="cylinder", summary="upright cylinder", config=SolidOptions, factory=Cylinder)
