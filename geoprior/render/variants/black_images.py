"""Black images: neither camera sees anything; the hand's poses are all that is left to learn from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from geoprior import VariantSpec, hookimpl
from geoprior.options import Options

if TYPE_CHECKING:
    from geoprior.render.clouds import Shot


class BlackImagesConfig(Options):
    """No options."""


@dataclass(frozen=True)
class BlackImages:
    """See `geoprior.hooks.types.Variant`. A frame is what the renderer draws of nothing: black."""

    config: BlackImagesConfig

    def change(self, shots: Mapping[str, Shot]) -> Mapping[str, Shot]:
        """Take every cloud away."""
        return {camera: replace(shot, clouds=()) for camera, shot in shots.items()}


@hookimpl
def geoprior_variants() -> Iterable[VariantSpec]:
    """One variant."""
    yield VariantSpec(
        name="black-images",
        summary="every camera sees nothing",
        config=BlackImagesConfig,
        factory=BlackImages,
    )
