"""No hand cube: the hand is not drawn, so that no view shows where it is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from geoprior import VariantSpec, hookimpl
from geoprior.options import Options

if TYPE_CHECKING:
    from geoprior.render.clouds import Shot


class NoHandCubeConfig(Options):
    """No options."""


@dataclass(frozen=True)
class NoHandCube:
    """See `geoprior.hooks.types.Variant`. The hand camera never saw the cube: its view stays."""

    config: NoHandCubeConfig

    def change(self, shots: Mapping[str, Shot]) -> Mapping[str, Shot]:
        """Take the hand's clouds away."""
        return {
            camera: replace(shot, clouds=tuple(cloud for cloud in shot.clouds if cloud.body != "hand"))
            for camera, shot in shots.items()
        }


@hookimpl
def geoprior_variants() -> Iterable[VariantSpec]:
    """One variant."""
    yield VariantSpec(
        name="no-hand-cube",
        summary="the third-person view lacks the hand's cube",
        config=NoHandCubeConfig,
        factory=NoHandCube,
    )
