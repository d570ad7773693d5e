"""My-plugin: some of the episodes that the generate stage wrote, as a source of geoprior's pretraining."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import SourceSpec, hookimpl
from geoprior.options import Options

if TYPE_CHECKING:
    from geoprior.sources.source import Source, SourceContext


class MyPluginConfig(Options):
    """Options of the source."""

    every: int = Field(2, ge=1, description="Of so many episodes one is used.")


def build(config: MyPluginConfig, context: SourceContext) -> Source:
    """Import the reader and open the run's shards; nothing heavy is imported before."""
    from geoprior.authoring.scaffold.templates.source._episodes import SomeEpisodes

    return SomeEpisodes(config.every, context)


@hookimpl
def geoprior_sources() -> Iterable[SourceSpec]:
    """What this package adds."""
    yield SourceSpec(
        name="my-plugin",
        summary="every second episode that the generate stage wrote",
        config=MyPluginConfig,
        factory=build,
    )
