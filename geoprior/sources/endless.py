"""Episodes made while training, for training alone. Registering imports nothing heavy: the factory does."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import SourceSpec, hookimpl
from geoprior.options import Options

if TYPE_CHECKING:
    from geoprior.sources.source import Source, SourceContext


class EndlessConfig(Options):
    """How many episodes there are, how long each is used, and who makes them."""

    speed_only = frozenset({"workers"})

    episodes: int | None = Field(
        None,
        ge=1,
        le=10_000_000,
        description="Episodes of each motion in an epoch; null takes generate.episodes.",
    )
    keep: int = Field(
        8,
        ge=1,
        le=10_000_000,
        description="Epochs that an episode is used for, each at another time step, before a fresh one takes "
        "its place.",
    )
    workers: int = Field(
        1,
        ge=0,
        le=1024,
        description="Processes that make episodes; 0 makes them in the trainer. Never changes a result.",
    )


def _build(config: EndlessConfig, context: SourceContext) -> Source:
    from geoprior.sources._endless import EndlessSource

    return EndlessSource(config, context)


@hookimpl
def geoprior_sources() -> Iterable[SourceSpec]:
    """One source."""
    yield SourceSpec(
        name="endless",
        summary="fresh episodes of the same kind, made while training",
        config=EndlessConfig,
        factory=_build,
    )
