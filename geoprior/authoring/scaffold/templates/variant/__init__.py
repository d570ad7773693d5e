"""My-plugin: fewer points in every cloud, as a variant of geoprior's synthetic episodes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import VariantSpec, hookimpl
from geoprior.options import Options

if TYPE_CHECKING:
    from geoprior.render.clouds import Cloud, Shot


class MyPluginConfig(Options):
    """Options of the variant."""

    every: int = Field(3, ge=1, le=1000, description="Of so many points one is kept.")


@dataclass(frozen=True)
class MyPlugin:
    """See `geoprior.hooks.types.Variant`. It changes what the cameras see, and nothing else."""

    config: MyPluginConfig

    def change(self, shots: Mapping[str, Shot]) -> Mapping[str, Shot]:
        """Thin every cloud out; the shots that were given stay as they are."""
        return {camera: replace(shot, clouds=self._thinned(shot)) for camera, shot in shots.items()}

    def _thinned(self, shot: Shot) -> tuple[Cloud, ...]:
        return tuple(replace(cloud, points=cloud.points[:: self.config.every]) for cloud in shot.clouds)


@hookimpl
def geoprior_variants() -> Iterable[VariantSpec]:
    """What this package adds."""
    yield VariantSpec(
        name="my-plugin",
        summary="every cloud has a third of its points",
        config=MyPluginConfig,
        factory=MyPlugin,
    )
