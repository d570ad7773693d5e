"""My-plugin: one pixel for each point, in plain NumPy, as a renderer of geoprior's synthetic episodes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import RendererSpec, hookimpl
from geoprior.geometry.projection import NEAREST, project
from geoprior.geometry.se3 import apply
from geoprior.options import Options
from geoprior.render.packing import pack_frames

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.projection import View
    from geoprior.render.clouds import Cloud


class MyPluginConfig(Options):
    """Options of the renderer."""

    farthest: float = Field(10.0, gt=0.0, description="Points beyond this are not drawn, metres.")


@dataclass(frozen=True)
class MyPlugin:
    """See `geoprior.hooks.types.Renderer`."""

    config: MyPluginConfig

    def render(self, clouds: Sequence[Cloud], view: View, steps: int) -> NDArray[np.uint8]:
        """Draw the frames of one camera, packed eight pixels a byte."""
        frames = np.zeros((steps, view.height, view.width), dtype=np.uint8)
        for step in range(steps):
            for cloud in clouds:
                points = apply(_at(cloud.transforms_cloud_to_world, step), cloud.points)
                self._draw(frames[step], points, _at(view.transforms_world_to_camera, step), view)
        return pack_frames(frames)

    def _draw(
        self,
        frame: NDArray[np.uint8],
        points: NDArray[np.float64],
        camera: NDArray[np.float64],
        view: View,
    ) -> None:
        pixels, depth = project(points, camera, view.intrinsics)
        seen = (depth > NEAREST) & (depth < self.config.farthest)
        columns, rows = np.rint(pixels[seen]).astype(np.int64).T
        inside = (columns >= 0) & (columns < view.width) & (rows >= 0) & (rows < view.height)
        frame[rows[inside], columns[inside]] = 255


def _at(transforms: NDArray[np.float64], step: int) -> NDArray[np.float64]:
    """The transform (4, 4) of a step: those of a thing at rest are one."""
    return transforms[step] if transforms.ndim == 3 else transforms


@hookimpl
def geoprior_renderers() -> Iterable[RendererSpec]:
    """What this package adds."""
    yield RendererSpec(
        name="my-plugin",
        summary="one white pixel for each point",
        config=MyPluginConfig,
        factory=MyPlugin,
    )
