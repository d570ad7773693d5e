"""Spheres; stretched, they are ellipsoids."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import PrimitiveSpec, hookimpl
from geoprior.scene.ranges import LengthRange, uniform
from geoprior.scene.solids import StretchOptions, solid, unit_sphere

if TYPE_CHECKING:
    import numpy as np

    from geoprior.scene.mesh import Mesh


class SphereConfig(StretchOptions):
    """Size and stretch."""

    diameter: LengthRange = Field((0.02, 0.12), description="Diameter before the stretch, metres.")


@dataclass(frozen=True)
class Sphere:
    """See `geoprior.hooks.types.Primitive`."""

    config: SphereConfig

    def sample(self, rng: np.random.Generator) -> Mesh:
        """Draw a sphere or an ellipsoid."""
        diameter = uniform(rng, self.config.diameter)
        return solid(unit_sphere(), (diameter,) * 3, self.config, rng, diameter=diameter)


@hookimpl
def geoprior_primitives() -> Iterable[PrimitiveSpec]:
    """One family."""
    yield PrimitiveSpec(
        name="sphere", summary="sphere, stretched to an ellipsoid", config=SphereConfig, factory=Sphere
    )
