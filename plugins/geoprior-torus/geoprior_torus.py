"""A torus, as a primitive of geoprior's synthetic scenes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from pydantic import Field

from geoprior import PrimitiveSpec, hookimpl
from geoprior.options import Options
from geoprior.scene.mesh import Mesh

AROUND, ACROSS = 48, 24


class TorusConfig(Options):
    """Options of the torus, in metres."""

    smallest: float = Field(0.02, gt=0.0, le=0.5, description="Smallest radius of the ring.")
    largest: float = Field(0.05, gt=0.0, le=0.5, description="Largest radius of the ring.")
    slimness: float = Field(0.35, gt=0.0, lt=1.0, description="Radius of the tube over that of the ring.")


class Torus:
    """A ring that lies flat, its axis along z."""

    def __init__(self, config: TorusConfig) -> None:
        self.config = config

    def sample(self, rng: np.random.Generator) -> Mesh:
        """Draw one torus; see `geoprior.hooks.types.Primitive`."""
        ring = rng.uniform(self.config.smallest, self.config.largest)
        return torus_mesh(ring, ring * self.config.slimness)


def torus_mesh(ring: float, tube: float) -> Mesh:
    """A closed torus about z.

    Args:
        ring: Radius of the tube's centre line, metres.
        tube: Radius of the tube, metres; less than ``ring``.
    """
    around, across = np.meshgrid(np.arange(AROUND), np.arange(ACROSS), indexing="ij")
    u, v = 2.0 * np.pi * around / AROUND, 2.0 * np.pi * across / ACROSS
    reach = ring + tube * np.cos(v)
    vertices = np.stack([reach * np.cos(u), reach * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)

    def index(i: np.ndarray, j: np.ndarray) -> np.ndarray:
        return (i % AROUND) * ACROSS + j % ACROSS

    a, b = index(around, across), index(around + 1, across)
    c, d = index(around + 1, across + 1), index(around, across + 1)
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return Mesh(vertices, faces.astype(np.int64))


@hookimpl
def geoprior_primitives() -> Iterable[PrimitiveSpec]:
    """Offer the torus."""
    yield PrimitiveSpec(
        name="torus", summary="a ring that lies flat on the floor", config=TorusConfig, factory=Torus
    )
