"""Lighter pictures of an arm: fewer triangles to draw, in place, with the physics left alone.

An arm's visual meshes hold 124,000 to 172,000 triangles, and a software renderer spends its time on them:
most are smaller than a pixel. MuJoCo's collision detection works on vertices and convex hulls, and inertia is
computed when a model is compiled, so that triangles are for the eye alone; a test holds that to the bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import mujoco
    from numpy.typing import NDArray

ROWS = 128
CELL = 0.006
"""Metres: the side of the cubic cells within which vertices are merged, for frames of `ROWS` rows or fewer;
more rows, smaller cells. At 0.8 m from a camera of 50 degrees this is the width of a pixel."""

CELL_OF_EXTENT = 0.04
"""Share of a mesh's largest side, for meshes so large that this exceeds `CELL` (a pedestal, a base)."""


def lighten_meshes(model: mujoco.MjModel, rows: int = ROWS) -> tuple[int, int]:
    """Merge nearby vertices of every mesh.

    Every vertex gives way to the first vertex in its grid cell; triangles that collapse or that repeat
    another one are dropped. Vertices, normals and hulls stay in the model: only the triangles' index rows
    are rewritten. To be called before a rendering context uploads the meshes.

    Args:
        model: Changed in place (``mesh_face``, ``mesh_facenormal``, ``mesh_facetexcoord``, ``mesh_facenum``).
        rows: Of the frames that will be drawn.

    Returns:
        Numbers of triangles before and after, over all meshes.
    """
    before = int(model.mesh_facenum.sum())
    for mesh in range(model.nmesh):
        _lighten(model, mesh, min(1.0, ROWS / rows))
    return before, int(model.mesh_facenum.sum())


def cluster_triangles(
    vertices: NDArray[np.float32], triangles: NDArray[np.int32], cell: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Vertex clustering on a grid, with existing vertices as representatives.

    Args:
        vertices: (V, 3) metres.
        triangles: (F, 3) rows of vertex numbers.
        cell: Side of a grid cell, metres.

    Returns:
        The new triangles (G, 3), and for each the number of the triangle it came from (G,).
    """
    cells = np.floor(np.asarray(vertices, dtype=np.float64) / cell).astype(np.int64)
    _, first, cluster = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    merged = first[cluster.reshape(-1)][triangles]
    whole = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])
    kept = np.flatnonzero(whole)
    _, unique = np.unique(np.sort(merged[kept], axis=1), axis=0, return_index=True)
    kept = kept[np.sort(unique)]
    return merged[kept], kept


def _lighten(model: mujoco.MjModel, mesh: int, coarseness: float) -> None:
    start, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    first, vertices = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    old = slice(start, start + count)
    points = model.mesh_vert[first : first + vertices]
    side = coarseness * max(CELL, CELL_OF_EXTENT * float(np.ptp(points, axis=0).max()))
    triangles, source = cluster_triangles(points, model.mesh_face[old], side)
    if not len(triangles):
        return
    new = slice(start, start + len(triangles))
    for rows in (model.mesh_facenormal, model.mesh_facetexcoord):
        rows[new] = rows[old][source]
    model.mesh_face[new] = triangles
    model.mesh_facenum[mesh] = len(triangles)
