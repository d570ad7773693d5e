"""No hand cube: neither hand nor fingers nor arm are drawn, so that no view shows where they are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from geoprior import VariantSpec, hookimpl
from geoprior.options import Options
from geoprior.scene.hand import HAND_BODIES

if TYPE_CHECKING:
    from geoprior.render.clouds import Shot


class NoHandCubeConfig(Options):
    """No options."""


@dataclass(frozen=True)
class NoHandCube:
    """See `geoprior.hooks.types.Variant`. The hand camera never saw the cube."""

    config: NoHandCubeConfig

    def change(self, shots: Mapping[str, Shot]) -> Mapping[str, Shot]:
        """Take away the clouds of the hand and of what belongs to it."""
        return {
            camera: replace(
                shot, clouds=tuple(cloud for cloud in shot.clouds if cloud.body not in HAND_BODIES)
            )
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
