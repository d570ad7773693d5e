"""My-plugin: a wedge, as a primitive of geoprior's synthetic scenes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import PrimitiveSpec, hookimpl
from geoprior.options import Options
from geoprior.scene.mesh import convex_mesh
from geoprior.scene.ranges import LengthRange, uniform

if TYPE_CHECKING:
    from geoprior.scene.mesh import Mesh


class MyPluginConfig(Options):
    """Options of the primitive; metres."""

    length: LengthRange = Field((0.03, 0.08), description="Along the slope, metres.")
    width: LengthRange = Field((0.03, 0.08), description="Across the slope, metres.")
    height: LengthRange = Field((0.02, 0.06), description="Of the upright side, metres.")


@dataclass(frozen=True)
class MyPlugin:
    """See `geoprior.hooks.types.Primitive`. Every draw comes from ``rng``: a seed gives the same solid."""

    config: MyPluginConfig

    def sample(self, rng: np.random.Generator) -> Mesh:
        """Draw one solid: a closed mesh in metres, wherever its origin is."""
        length = uniform(rng, self.config.length)
        width = uniform(rng, self.config.width)
        height = uniform(rng, self.config.height)
        return convex_mesh(corners(length, width, height))


def corners(length: float, width: float, height: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """(6, 3) vertices: a right-angled triangle, drawn out along y."""
    triangle = [(0.0, 0.0), (length, 0.0), (0.0, height)]
    return np.array([(x, y, z) for y in (0.0, width) for x, z in triangle])


@hookimpl
def geoprior_primitives() -> Iterable[PrimitiveSpec]:
    """What this package adds."""
    yield PrimitiveSpec(
        name="my-plugin",
        summary="a wedge: a right-angled triangle, drawn out",
        config=MyPluginConfig,
        factory=MyPlugin,
    )
