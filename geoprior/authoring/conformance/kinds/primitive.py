"""A primitive: closed solids of a hand's size, and nothing but its generator decides which."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from geoprior.authoring.conformance.check import Check, digest, require, require_array
from geoprior.geometry.seeding import generator
from geoprior.hooks.types import PrimitiveSpec
from geoprior.scene.mesh import Mesh, bounds, extents

SMALLEST, LARGEST = 0.002, 0.5
"""Metres that a solid may measure along each axis: a hand's scale."""
SEEDS = range(20)


def draws(spec: PrimitiveSpec, seeds: Iterable[int] = SEEDS) -> Iterator[tuple[str, Mesh]]:
    """The solid of each seed with the default options, and what to call it in a message."""
    primitive = spec.factory(spec.config())
    for seed in seeds:
        yield f"primitive {spec.name!r}, seed {seed}", primitive.sample(generator(seed, "conformance"))


def arrays_are_a_mesh(spec: PrimitiveSpec, seeds: Iterable[int] = SEEDS) -> None:
    """Vertices are float64, faces are int64 and name vertices; what was drawn can stand in a header."""
    for where, mesh in draws(spec, seeds):
        vertices = require_array(mesh.vertices, f"{where}: vertices", (None, 3), np.float64)
        faces = require_array(mesh.faces, f"{where}: faces", (None, 3), np.int64)
        require(
            faces.min() >= 0 and faces.max() < len(vertices),
            f"{where}: a face names a vertex that is not there",
        )
        for name, value in mesh.parameters.items():
            require(
                isinstance(name, str) and isinstance(value, (int, float)) and np.isfinite(value),
                f"{where}: parameter {name!r} is {value!r}",
                "parameters are names and finite Python numbers",
            )


def surfaces_are_closed(spec: PrimitiveSpec, seeds: Iterable[int] = SEEDS) -> None:
    """Every edge is met once in each direction, and the faces look outwards."""
    for where, mesh in draws(spec, seeds):
        require_closed(mesh, where)


def is_of_a_hands_size(spec: PrimitiveSpec, seeds: Iterable[int] = SEEDS) -> None:
    """Every side of the bounding box lies between `SMALLEST` and `LARGEST`."""
    for where, mesh in draws(spec, seeds):
        sides = extents(mesh)
        require(
            (sides > SMALLEST).all() and (sides < LARGEST).all(),
            f"{where}: measures {sides.round(4).tolist()} m along x, y and z",
            f"lengths are metres; each side must lie between {SMALLEST} and {LARGEST}",
        )


def only_its_generator_decides(spec: PrimitiveSpec, seeds: Iterable[int] = SEEDS) -> None:
    """The same seed gives the same solid, from another object and after others; seeds differ."""
    first = list(draws(spec, seeds))
    again = list(draws(spec, reversed(list(seeds))))
    for (where, mesh), (_, same) in zip(first, reversed(again), strict=True):
        require(
            digest(mesh) == digest(same),
            f"{where}: draws from elsewhere than its rng",
            "take every random number from the argument of `sample`, and keep nothing between calls",
        )
    require(
        len(first) < 2 or len({digest(mesh.vertices) for _, mesh in first}) > 1,
        f"primitive {spec.name!r}: every seed gives the same solid",
        "draw its size from `rng`",
    )


def require_closed(mesh: Mesh, where: str) -> None:
    """Check that every edge is met once in each direction and that the enclosed volume is positive.

    Raises:
        BrokenContractError: It is not so.
    """
    require(np.isfinite(mesh.vertices).all(), f"{where}: a vertex is not finite")
    faces = mesh.faces
    edges = {tuple(edge) for edge in np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])}
    require(
        len(edges) == 3 * len(faces),
        f"{where}: two faces use an edge in the same direction",
        "order each face's vertices counter-clockwise seen from outside",
    )
    require(
        edges == {(b, a) for a, b in edges},
        f"{where}: an edge has one face only; the surface is open",
        "close the mesh; geoprior.scene.mesh.convex_mesh makes one of any points",
    )
    a, b, c = (mesh.vertices[faces[:, corner]] for corner in range(3))
    volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0
    require(
        volume > 0.0,
        f"{where}: its faces look inwards (volume {volume:.3g} m³, box {bounds(mesh)})",
        "swap two columns of `faces`",
    )


CHECKS = (
    Check("its arrays are a mesh", arrays_are_a_mesh),
    Check("its solids are closed and face outwards", surfaces_are_closed),
    Check("its solids are of a hand's size", is_of_a_hands_size),
    Check("a seed decides the solid, and nothing else does", only_its_generator_decides),
)
