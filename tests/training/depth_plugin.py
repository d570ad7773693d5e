"""A renderer of somebody else's: how near each pixel is, in 8-bit gray, by rays against triangles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from geoprior import RendererSpec, hookimpl
from geoprior.geometry.projection import NEAREST
from geoprior.geometry.se3 import apply
from geoprior.options import Options


class DepthConfig(Options):
    farthest: float = Field(2.0, gt=0.1, description="What is beyond is black, metres.")


@dataclass(frozen=True)
class Depth:
    frames: ClassVar = "gray"

    config: DepthConfig

    def render(self, shot):
        view = shot.view
        rows, columns = np.mgrid[: view.height, : view.width]
        pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1).reshape(-1, 3)
        rays = pixels @ np.linalg.inv(view.intrinsics).T
        frames = [self.draw(shot, rays, step) for step in range(shot.steps)]
        return np.array(frames, np.uint8).reshape(shot.steps, view.height, view.width)

    def draw(self, shot, rays, step):
        depth = np.full(len(rays), np.inf)
        camera = at(shot.view.transforms_world_to_camera, step)
        for cloud in shot.clouds:
            if cloud.surface is not None:
                seen = apply(camera @ at(cloud.transforms_cloud_to_world, step), cloud.surface.vertices)
                depth = np.minimum(depth, nearest_hit(rays, seen[cloud.surface.faces]))
        return np.rint(255.0 * np.clip(1.0 - depth / self.config.farthest, 0.0, 1.0))


def nearest_hit(rays, triangles):
    """Depth (R,) at which rays from the origin first meet triangles (F, 3, 3)."""
    a, b, c = triangles.transpose(1, 0, 2)
    sides = [rays @ np.cross(one, two).T for one, two in ((a, b), (b, c), (c, a))]
    inside = np.all([side >= 0.0 for side in sides], axis=0) | np.all([side <= 0.0 for side in sides], axis=0)
    normals = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        depths = np.sum(a * normals, axis=1) / (rays @ normals.T)
    return np.where(inside & (depths > NEAREST), depths, np.inf).min(axis=1)


def at(transforms, step):
    return transforms[step] if transforms.ndim == 3 else transforms


class DepthPlugin:
    @hookimpl
    def geoprior_renderers(self):
        yield RendererSpec("depth", "the nearer, the brighter", DepthConfig, Depth)
