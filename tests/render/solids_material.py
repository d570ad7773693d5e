"""What frames of solids should be: a ray through every pixel's middle, against every triangle, in float64."""

from __future__ import annotations

import numpy as np

NEAREST = 0.01
LIFT = 1e-4
"""Share of its depth by which the marker is nearer than it is, to lie over the floor."""


def at(transforms, step):
    return transforms[step] if transforms.ndim == 3 else transforms


def rays(view, shift=(0.0, 0.0)):
    """(H W, 3) directions of depth 1 in the camera's frame, through (column, row) moved by ``shift``."""
    rows, columns = np.mgrid[: view.height, : view.width]
    pixels = np.stack([columns + shift[0], rows + shift[1], np.ones_like(rows)], axis=-1).reshape(-1, 3)
    return pixels @ np.linalg.inv(view.intrinsics).T


def hits(triangles, directions):
    """Depths (R, F) at which rays from the origin meet the outer side of triangles (F, 3, 3), else infinity.

    Cramer's rule on direction = a + s (b - a) + t (c - a).
    """
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normals = np.cross(b - a, c - a)
    facing = directions @ normals.T
    with np.errstate(divide="ignore", invalid="ignore"):
        depths = np.sum(a * normals, axis=1) / facing
        inside = np.ones(facing.shape, bool)
        for one, two in ((a, b), (b, c), (c, a)):
            inside &= directions @ np.cross(one, two).T * np.sign(facing) >= 0.0
    return np.where((facing < 0.0) & inside & (depths >= NEAREST), depths, np.inf)


def reference_frame(shot, appearance, step, shift=(0.0, 0.0)):
    """One frame (H, W, 3) of a shot, float64 of 0 to 255."""
    camera = at(shot.view.transforms_world_to_camera, step)
    directions = rays(shot.view, shift)
    best = np.full(len(directions), np.inf)
    colours = np.tile(255.0 * appearance.background, (len(directions), 1))
    for cloud in shot.clouds:
        if cloud.surface is None:
            continue
        world = at(cloud.transforms_cloud_to_world, step)
        corners = cloud.surface.vertices[cloud.surface.faces] @ world[:3, :3].T + world[:3, 3]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        lit = appearance.ambient + np.maximum(normals @ appearance.light, 0.0)
        depths = hits(corners @ camera[:3, :3].T + camera[:3, 3], directions)
        face = depths.argmin(axis=1)
        depth = depths[np.arange(len(directions)), face]
        depth /= 1.0 + LIFT * (cloud.body == "marker")
        nearer = depth < best
        best[nearer] = depth[nearer]
        colours[nearer] = 255.0 * lit[face[nearer], None] * appearance.colour(cloud.body)
    return colours.reshape(shot.view.height, shot.view.width, 3)


def differing(frame, reference):
    """(H, W) whether a pixel is more than a level off."""
    return (np.abs(frame - reference) > 1.0).any(axis=-1)
