"""A solid drawn by its lines: its sharp edges, and where its surface turns away from the eye."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.se3 import apply
from geoprior.view.marks import Lines

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.scene.mesh import Mesh
    from geoprior.view.palette import Colour

    FloatArray = NDArray[np.float64]

_SHARP = np.cos(np.radians(30.0))
_HIDDEN = 0.4


@dataclass(frozen=True)
class Solid:
    """A body's surface and where it is.

    Attributes:
        body: Whose it is; see `Cloud`.
        mesh: In the body's own frame.
        transforms_solid_to_world: (4, 4) of a body at rest, or (N, 4, 4).
    """

    body: str
    mesh: Mesh
    transforms_solid_to_world: FloatArray

    @cached_property
    def normals(self) -> FloatArray:
        """(F, 3) outward unit normals in the body's frame."""
        a, b, c = (self.mesh.vertices[self.mesh.faces[:, corner]] for corner in range(3))
        normals = np.cross(b - a, c - a)
        return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))

    @cached_property
    def edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Vertices (E, 2) of each edge, and the faces (E, 2) beside it: one twice where it has no other."""
        faces = self.mesh.faces
        halves = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        edges, which, counts = np.unique(halves, axis=0, return_inverse=True, return_counts=True)
        owners = np.tile(np.arange(len(faces)), 3)[np.argsort(which.ravel(), kind="stable")]
        ends = np.cumsum(counts)
        return edges, np.stack([owners[ends - counts], owners[ends - 1]], axis=1)

    @cached_property
    def sharp(self) -> NDArray[np.bool_]:
        """(E,) whether the surface bends at an edge, or ends there."""
        one, other = self.edges[1].T
        bend = np.sum(self.normals[one] * self.normals[other], axis=1)
        return np.asarray((bend < _SHARP) | (one == other))


@dataclass(frozen=True)
class Outline:
    """A mark: a solid at one place.

    Attributes:
        solid: What.
        transform_solid_to_world: (4, 4).
        colour: RGB.
        strength: See `Dots`.
    """

    solid: Solid
    transform_solid_to_world: FloatArray
    colour: Colour
    strength: float = 1.0

    @property
    def places(self) -> FloatArray:
        """(P, 3) what must be in a picture that has it whole."""
        return apply(self.transform_solid_to_world, self.solid.mesh.vertices)

    def lines(self, eye: FloatArray) -> list[Lines]:
        """What is drawn for an eye (3,) in the world: the lines before the solid, and those behind it."""
        transform = self.transform_solid_to_world
        vertices = self.places
        normals = self.solid.normals @ transform[:3, :3].T
        to_eye = eye - vertices[self.solid.mesh.faces[:, 0]]
        edges, beside = self.solid.edges
        one, other = (np.sum(normals * to_eye, axis=1) > 0.0)[beside].T
        segments = vertices[edges]
        seen = (one != other) | (self.solid.sharp & one)
        hidden = self.solid.sharp & ~one & ~other
        return [
            Lines(segments[seen], 1, self.colour, self.strength),
            Lines(segments[hidden], 1, self.colour, self.strength * _HIDDEN),
        ]
