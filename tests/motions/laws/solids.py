"""Whether two convex solids share a volume: exactly, and fast where the answer is plainly no."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from geoprior.geometry.se3 import apply

UNIT_CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-1.0, 0.0)])
"""Corners of a hand cube of side 1 in the hand frame."""
CUBE_NORMALS = np.vstack([np.eye(3), -np.eye(3)])
CUBE_OFFSETS = np.array([0.5, 0.5, 0.0, 0.5, 0.5, 1.0])


def half_spaces(mesh):
    """Outward unit normals (F, 3) and offsets (F,) with ``normals @ x <= offsets`` inside a convex mesh."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, np.sum(normals * a, axis=1)


def depth_of_the_hand_in_the_object(mesh, cube, transforms_hand_to_object):
    """(N,) radius of the largest ball in both the hand cube and a convex mesh; below 0 where they are apart.

    A face plane of either that has the other wholly beyond it settles most steps; a linear program settles
    the others.
    """
    normals, offsets = half_spaces(mesh)
    corners = apply(transforms_hand_to_object, cube * UNIT_CUBE)
    beyond_object = (corners @ normals.T - offsets).min(axis=1).max(axis=1)
    rotations, positions = transforms_hand_to_object[:, :3, :3], transforms_hand_to_object[:, :3, 3]
    vertices = (mesh.vertices - positions[:, None]) @ rotations
    beyond_cube = (vertices @ CUBE_NORMALS.T - cube * CUBE_OFFSETS).min(axis=1).max(axis=1)
    depths = -np.maximum(beyond_object, beyond_cube)
    for step in np.flatnonzero(depths > 0.0):
        cube_normals = CUBE_NORMALS @ rotations[step].T
        planes = np.vstack([normals, cube_normals])
        limits = np.concatenate([offsets, cube * CUBE_OFFSETS + cube_normals @ positions[step]])
        depths[step] = _deepest(planes, limits)
    return depths


def _deepest(planes, limits):
    constraints = np.column_stack([planes, np.ones(len(planes))])
    free = [(None, None)] * 4
    solved = linprog([0.0, 0.0, 0.0, -1.0], A_ub=constraints, b_ub=limits, bounds=free)
    assert solved.success, solved.message
    return solved.x[3]
