"""The paper's renderer: points projected onto black frames, each a small white square.

"Visible" means: before the camera and inside the frame. A point has no size and hides nothing, so the far
side of an object shows through its near side, and the floor through both. The frames are sparse and binary,
0 or 255.

A point at pixel coordinates (u, v), pixel centres at whole numbers, covers ``footprint`` columns from
``floor(u + 1 - footprint / 2)`` on, and rows likewise: the square of whole pixels whose middle is nearest.
What reaches over the frame's edge is cut off.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from geoprior import RendererSpec, hookimpl
from geoprior.geometry.projection import NEAREST
from geoprior.options import Options

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from geoprior.episode import FrameKind
    from geoprior.geometry.projection import View
    from geoprior.render.clouds import Cloud, Shot


class PointsConfig(Options):
    """Options of the point renderer."""

    footprint: int = Field(2, ge=1, le=16, description="Side of the square that a point covers, pixels.")


@dataclass(frozen=True)
class PointsRenderer:
    """See `geoprior.hooks.types.Renderer`.

    Attributes:
        footprint: Side of the square that a point covers, pixels.
        masks: See `geoprior.render._kernel.word_masks`.
        draw: The compiled kernel.
    """

    frames: ClassVar[FrameKind] = "binary"

    footprint: int
    masks: NDArray[np.uint64]
    draw: Callable[..., None]

    def render(self, shot: Shot) -> NDArray[np.uint8]:
        """Draw a shot's frames; what rests before a fixed camera is drawn once."""
        drawn = [(pixel_matrices(cloud, shot.view), axes_first(cloud.points)) for cloud in shot.clouds]
        return self.draw_all(drawn, shot.view, shot.steps)

    def draw_all(
        self, drawn: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]], view: View, steps: int
    ) -> NDArray[np.uint8]:
        """Draw what `pixel_matrices` and `axes_first` made of clouds; see `render`."""
        words = np.zeros((steps, view.height, -(-view.width // 64)), dtype=np.uint64)
        resting = [(matrix, points) for matrix, points in drawn if matrix.ndim == 2]
        for matrix, points in resting:
            self._draw(words[:1], view, matrix[None], points)
        if resting:
            words[1:] = words[:1]
        for matrices, points in drawn:
            if matrices.ndim == 3:
                self._draw(words, view, matrices, points)
        return np.ascontiguousarray(words.view(np.uint8)[..., : -(-view.width // 8)])

    def _draw(
        self,
        words: NDArray[np.uint64],
        view: View,
        matrices: NDArray[np.float64],
        points: NDArray[np.float64],
    ) -> None:
        self.draw(words, view.width, matrices, points, self.footprint, self.masks, NEAREST)


def axes_first(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (P, 3) as (3, P), each axis in one piece for the vector unit."""
    return np.ascontiguousarray(points.T)


def pixel_matrices(cloud: Cloud, view: View) -> NDArray[np.float64]:
    """Matrices from a cloud's frame to homogeneous pixels: (3, 4) if nothing moves, else (N, 3, 4)."""
    transforms = view.transforms_world_to_camera @ cloud.transforms_cloud_to_world
    return np.ascontiguousarray(view.intrinsics @ transforms[..., :3, :])


def build(config: PointsConfig) -> PointsRenderer:
    """Import numba and build the renderer."""
    from geoprior.render._kernel import draw, word_masks

    return PointsRenderer(config.footprint, word_masks(config.footprint), draw)


@hookimpl
def geoprior_renderers() -> Iterable[RendererSpec]:
    """One renderer."""
    yield RendererSpec(
        name="points",
        summary="white points on black, projected without occlusion",
        config=PointsConfig,
        factory=build,
    )
