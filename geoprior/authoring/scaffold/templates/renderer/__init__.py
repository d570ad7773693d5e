"""My-plugin: one pixel for each point, in plain NumPy, as a renderer of geoprior's synthetic episodes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import RendererSpec, hookimpl
from geoprior.episode import FrameKind
from geoprior.geometry.projection import NEAREST, project
from geoprior.geometry.se3 import apply
from geoprior.options import Options
from geoprior.render.packing import pack_frames

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.projection import View
    from geoprior.render.clouds import Shot


class MyPluginConfig(Options):
    """Options of the renderer."""

    frames: FrameKind = Field(
        "gray", description="What is drawn: black and white (binary), gray, or RGB (rgb)."
    )
    farthest: float = Field(10.0, gt=0.0, description="Points beyond this are not drawn, metres.")


@dataclass(frozen=True)
class MyPlugin:
    """See `geoprior.hooks.types.Renderer`. A near point is bright; the nearest one of a pixel is seen."""

    config: MyPluginConfig

    @property
    def frames(self) -> FrameKind:
        """What `render` gives. Most renderers know one kind: `frames: ClassVar[FrameKind] = "gray"`."""
        return self.config.frames

    def render(self, shot: Shot) -> NDArray[np.uint8]:
        """Draw the frames of one camera."""
        levels = np.zeros((shot.steps, shot.view.height, shot.view.width), dtype=np.uint8)
        for step in range(shot.steps):
            camera = _at(shot.view.transforms_world_to_camera, step)
            for cloud in shot.clouds:
                points = apply(_at(cloud.transforms_cloud_to_world, step), cloud.points)
                self._draw(levels[step], points, camera, shot.view)
        return _as(self.config.frames, levels)

    def _draw(
        self,
        levels: NDArray[np.uint8],
        points: NDArray[np.float64],
        camera: NDArray[np.float64],
        view: View,
    ) -> None:
        pixels, depth = project(points, camera, view.intrinsics)
        seen = (depth > NEAREST) & (depth < self.config.farthest)
        columns, rows = np.rint(pixels[seen]).astype(np.int64).T
        inside = (columns >= 0) & (columns < view.width) & (rows >= 0) & (rows < view.height)
        level = np.ceil(255.0 * (1.0 - depth[seen] / self.config.farthest)).astype(np.uint8)
        np.maximum.at(levels, (rows[inside], columns[inside]), level[inside])


def _as(kind: FrameKind, levels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Levels (N, H, W) as frames of a kind; what is not 0 is white in binary ones."""
    if kind == "binary":
        return pack_frames(levels)
    return np.repeat(levels[..., None], 3, axis=-1) if kind == "rgb" else levels


def _at(transforms: NDArray[np.float64], step: int) -> NDArray[np.float64]:
    """The transform (4, 4) of a step: those of a thing at rest are one."""
    return transforms[step] if transforms.ndim == 3 else transforms


@hookimpl
def geoprior_renderers() -> Iterable[RendererSpec]:
    """What this package adds."""
    yield RendererSpec(
        name="my-plugin",
        summary="one pixel for each point, the brighter the nearer",
        config=MyPluginConfig,
        factory=MyPlugin,
    )
