"""Closed triangle meshes: the one form in which every primitive hands over its solid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from geoprior.geometry.se3 import cross

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]


# Corner 4x + 2y + z of a box; each side as two triangles, counter-clockwise seen from outside.
_BOX_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


@dataclass(frozen=True)
class Mesh:
    """A surface; that of a solid is closed.

    Attributes:
        vertices: (V, 3) float64, metres, object frame.
        faces: (F, 3) int64, counter-clockwise seen from outside.
        parameters: What the primitive drew, for the episode's header: names and numbers.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    parameters: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def face_areas(self) -> FloatArray:
        """(F,) area of each triangle, square metres."""
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        return np.asarray(0.5 * np.linalg.norm(cross(b - a, c - a), axis=1))

    @cached_property
    def face_planes(self) -> tuple[FloatArray, FloatArray]:
        """Outward unit normals (F, 3), zeros of a face without area, and each face's height along its own."""
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        normals = cross(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.where(lengths > 0.0, lengths, 1.0)
        return normals, np.asarray(np.sum(normals * a, axis=1))


def convex_mesh(vertices: FloatArray) -> Mesh:
    """The convex hull of points as a mesh with outward faces (Qhull, by way of SciPy).

    Args:
        vertices: (V, 3) points, not all in one plane; those inside the hull are dropped.

    Raises:
        scipy.spatial.QhullError: The points span no volume.
    """
    from scipy.spatial import ConvexHull

    hull = ConvexHull(vertices)
    faces = hull.simplices.astype(np.int64)
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    inward = np.sum(cross(b - a, c - a) * hull.equations[:, :3], axis=1) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    used, renumbered = np.unique(faces, return_inverse=True)
    return Mesh(np.asarray(vertices, dtype=np.float64)[used], renumbered.reshape(faces.shape))


def box(low: FloatArray, high: FloatArray) -> Mesh:
    """The axis-aligned box between two corners (3,), as twelve triangles."""
    corners = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
    return Mesh(low + corners * (high - low), _BOX_FACES)


def square(side: float, height: float) -> Mesh:
    """A horizontal square about the z axis, seen from above; metres. It is a sheet, not closed."""
    half = 0.5 * side
    corners = [[-half, -half, height], [half, -half, height], [half, half, height], [-half, half, height]]
    return Mesh(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]))


def flat_hull(points: FloatArray) -> Mesh:
    """The convex hull, seen from above, of points (P, 3) of one height: a sheet, not closed.

    Raises:
        scipy.spatial.QhullError: The points lie on a line.
    """
    from scipy.spatial import ConvexHull

    corners = points[ConvexHull(points[:, :2]).vertices]  # counter-clockwise in the plane
    fan = np.arange(1, len(corners) - 1)
    return Mesh(corners, np.column_stack([np.zeros_like(fan), fan, fan + 1]))


def bounds(mesh: Mesh) -> tuple[FloatArray, FloatArray]:
    """The lowest and the highest corner, (3,) each, of the axis-aligned box in the mesh's own frame."""
    return mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)


def extents(mesh: Mesh) -> FloatArray:
    """(3,) edge lengths of the box of `bounds`, metres."""
    low, high = bounds(mesh)
    return high - low


def centred(mesh: Mesh) -> Mesh:
    """The mesh moved so that the middle of its bounding box is the origin."""
    low, high = bounds(mesh)
    return replace(mesh, vertices=mesh.vertices - 0.5 * (low + high))


def scaled(mesh: Mesh, factors: FloatArray) -> Mesh:
    """The mesh stretched by three positive factors along its axes."""
    return replace(mesh, vertices=mesh.vertices * factors)


def sample_surface(mesh: Mesh, count: int, rng: np.random.Generator) -> FloatArray:
    """Points on the surface, uniform by area.

    The surface is cut into ``count`` strips of equal area and each gives one point, which spreads the
    points more evenly than independent draws and leaves their mean density uniform.

    Returns:
        (count, 3) in the mesh's frame.
    """
    cumulative = np.cumsum(mesh.face_areas)
    strips = (np.arange(count) + rng.random(count)) * (cumulative[-1] / count)
    chosen = mesh.faces[np.minimum(np.searchsorted(cumulative, strips, side="right"), len(cumulative) - 1)]
    # sqrt makes (1 - s, s (1 - r), s r) uniform on the triangle (Osada et al., 2002).
    s, r = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    a, b, c = (mesh.vertices[chosen[:, corner]] for corner in range(3))
    return np.asarray((1.0 - s) * a + s * (1.0 - r) * b + s * r * c)


def points_for_density(mesh: Mesh, density: float) -> int:
    """How many points give ``density`` points a square metre; at least 32, so that none is invisible."""
    return max(32, round(float(mesh.face_areas.sum()) * density))
