"""Shaded, coloured solids that hide each other: flat faces, Lambert's law, one light, a depth buffer.

The scenes are those of `geoprior.render.points`, seen with their surfaces; colours and light are random, one
draw an episode (`geoprior.render.appearance`). There are no textures, shadows or meshes of real things. A
body is seen from outside only, so that a camera within one looks through it; what is nearer than `NEAREST` is
cut off. Bodies without a surface are not drawn. Sheets that lie in one place are drawn in their order: the
marker over the floor. Where no body is before a camera, the frame has the background's colour; where a
shot has no clouds at all, as of the variant `black-images`, its frames are black.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from geoprior import RendererSpec, hookimpl
from geoprior.geometry.projection import NEAREST
from geoprior.geometry.se3 import invert
from geoprior.render.appearance import AppearanceConfig, draw_appearance

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from geoprior.episode import FrameKind
    from geoprior.geometry.projection import View
    from geoprior.render._solids_kernel import Looks, Surfaces
    from geoprior.render.appearance import Appearance
    from geoprior.render.clouds import Cloud, Shot

_LIFT = 1e-4
"""Share of its depth by which a sheet lies before the last one: 0.1 mm at a metre, far above rounding."""

_NOTHING = (
    np.empty((0, 3)),
    np.empty((0, 3), np.int64),
    np.empty((0, 3)),
    np.empty(0),
    np.empty((0, 3)),
    np.empty(0),
    np.empty((0, 2), np.int64),
)
"""No bodies, in the order of the kernel's `Surfaces`."""


class SolidsConfig(AppearanceConfig):
    """Options of the renderer of solids."""


@dataclass(frozen=True)
class SolidsRenderer:
    """See `geoprior.hooks.types.Renderer`.

    Attributes:
        config: Its options.
        surfaces: The kernel's type of bodies.
        looks: The kernel's type of how they are seen.
        draw: The compiled kernel.
    """

    frames: ClassVar[FrameKind] = "rgb"

    config: SolidsConfig
    surfaces: type[Surfaces]
    looks: type[Looks]
    draw: Callable[..., None]

    def render(self, shot: Shot) -> NDArray[np.uint8]:
        """Draw a shot's frames; what rests before a fixed camera is drawn once."""
        view = shot.view
        frames = np.zeros((shot.steps, view.height, view.width, 3), np.uint8)
        if not shot.clouds:
            return frames
        appearance = draw_appearance(self.config, shot.seed)
        bodies = [cloud for cloud in shot.clouds if cloud.surface is not None]
        lifts = _lifts(bodies)
        moving = [_moves(cloud, view) for cloud in bodies]
        parts: list[Surfaces | Looks] = []
        for which in (False, True):
            some = [number for number, moves in enumerate(moving) if moves is which]
            chosen = [bodies[number] for number in some]
            parts.append(self._surfaces(chosen, [lifts[number] for number in some], appearance))
            parts.append(self._looks(chosen, view, shot.steps if which else 1, appearance))
        self.draw(frames, *parts, appearance.background, appearance.ambient, NEAREST)
        return frames

    def _surfaces(self, bodies: Sequence[Cloud], lifts: Sequence[float], appearance: Appearance) -> Surfaces:
        meshes = [cloud.surface for cloud in bodies if cloud.surface is not None]
        if not meshes:
            return self.surfaces(*_NOTHING)
        ends = np.cumsum([(len(mesh.vertices), len(mesh.faces)) for mesh in meshes], axis=0)
        firsts = [0, *ends[:-1, 0].tolist()]
        planes = [mesh.face_planes for mesh in meshes]
        return self.surfaces(
            np.concatenate([mesh.vertices for mesh in meshes]),
            np.concatenate([mesh.faces + first for mesh, first in zip(meshes, firsts, strict=True)]),
            np.concatenate([normals for normals, _ in planes]),
            np.concatenate([heights for _, heights in planes]),
            np.array([appearance.colour(cloud.body) for cloud in bodies]),
            1.0 + np.array(lifts),
            ends,
        )

    def _looks(self, bodies: Sequence[Cloud], view: View, steps: int, appearance: Appearance) -> Looks:
        matrices, eyes, lights = (np.empty((steps, len(bodies), *rest)) for rest in ((3, 4), (3,), (3,)))
        for number, cloud in enumerate(bodies):
            seen = view.transforms_world_to_camera @ cloud.transforms_cloud_to_world
            matrices[:, number] = view.intrinsics @ seen[..., :3, :]
            eyes[:, number] = invert(seen)[..., :3, 3]
            lights[:, number] = appearance.light @ cloud.transforms_cloud_to_world[..., :3, :3]
        return self.looks(matrices, eyes, lights)


def _moves(cloud: Cloud, view: View) -> bool:
    return cloud.transforms_cloud_to_world.ndim == 3 or view.transforms_world_to_camera.ndim == 3


def _lifts(bodies: Sequence[Cloud]) -> list[float]:
    """How much nearer than it is each body is drawn: sheets one over the other, solids as they are."""
    lifts, sheets = [], 0
    for cloud in bodies:
        sheet = cloud.surface is not None and np.ptp(cloud.surface.vertices[:, 2]) == 0.0
        lifts.append(sheets * _LIFT if sheet else 0.0)
        sheets += sheet
    return lifts


def build(config: SolidsConfig) -> SolidsRenderer:
    """Import numba and build the renderer."""
    from geoprior.render._solids_kernel import Looks, Surfaces, draw

    return SolidsRenderer(config, Surfaces, Looks, draw)


@hookimpl
def geoprior_renderers() -> Iterable[RendererSpec]:
    """One renderer."""
    yield RendererSpec(
        name="solids",
        summary="shaded, coloured solids that hide each other, in RGB",
        config=SolidsConfig,
        factory=build,
    )
