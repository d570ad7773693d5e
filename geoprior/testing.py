"""For authors of plug-ins: a fresh manager and conformance checks. A pytest plug-in.

In a ``conftest.py`` of your package::

    pytest_plugins = ["geoprior.testing"]
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from geoprior.geometry.seeding import generator
from geoprior.hooks.manager import Plugins
from geoprior.hooks.types import PrimitiveSpec
from geoprior.scene.mesh import Mesh

SMALLEST, LARGEST = 0.002, 0.5
"""Metres that a solid may measure along each axis: a hand's scale."""


@pytest.fixture
def fresh_plugins() -> Plugins:
    """A manager with the built-ins only; register your module on it."""
    found = Plugins()
    found.load_builtins()
    return found


def assert_primitive_conforms(spec: PrimitiveSpec, seeds: Iterable[int] = range(20)) -> None:
    """Check that a primitive with its default options keeps the contract.

    Its solids are closed, face outwards and are of a hand's size; the same seed gives the same solid, and
    different seeds do not all give one.

    Raises:
        AssertionError: Naming the primitive, the seed and the fault.
    """
    primitive = spec.factory(spec.config())
    seen = []
    for seed in seeds:
        where = f"primitive {spec.name!r}, seed {seed}"
        mesh = primitive.sample(generator(seed, "conformance"))
        again = primitive.sample(generator(seed, "conformance"))
        assert np.array_equal(mesh.vertices, again.vertices), f"{where}: draws from elsewhere than its rng"
        assert_closed(mesh, where)
        sides = np.ptp(mesh.vertices, axis=0)
        assert (sides > SMALLEST).all(), f"{where}: measures {sides} m"
        assert (sides < LARGEST).all(), f"{where}: measures {sides} m"
        seen.append(sides.tobytes())
    assert len(set(seen)) > 1 or len(seen) < 2, f"primitive {spec.name!r}: every seed gives the same solid"


def assert_closed(mesh: Mesh, where: str) -> None:
    """Check that every edge is met once in each direction and that the enclosed volume is positive."""
    assert np.isfinite(mesh.vertices).all(), f"{where}: a vertex is not finite"
    faces = mesh.faces
    edges = {tuple(edge) for edge in np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])}
    assert len(edges) == 3 * len(faces), f"{where}: two faces use an edge in the same direction"
    assert edges == {(b, a) for a, b in edges}, f"{where}: an edge has one face only; the surface is open"
    a, b, c = (mesh.vertices[faces[:, corner]] for corner in range(3))
    volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0
    assert volume > 0.0, f"{where}: its faces look inwards"
