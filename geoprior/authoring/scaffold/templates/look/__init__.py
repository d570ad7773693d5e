"""My-plugin: the lamp is dimmed, as a look of geoprior's simulated worlds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pydantic import Field

from geoprior import LookSpec, hookimpl
from geoprior.options import Options

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

    import mujoco
    import numpy as np


class MyPluginConfig(Options):
    """Options of the look."""

    darkest: float = Field(0.4, gt=0.0, le=1.0, description="The least share of the light that is left.")


@dataclass(frozen=True)
class MyPlugin:
    """See `geoprior.sim.looks.look.Look`. Physics must feel nothing of it."""

    config: MyPluginConfig

    def furnish(self, world: ET.Element) -> None:
        """Nothing is added."""

    def dress(self, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator) -> None:
        """Dim all light; what is written here is undone before the next episode."""
        del data
        share = rng.uniform(self.config.darkest, 1.0)
        model.light_diffuse[:] *= share
        model.vis.headlight.ambient[:] *= share
        model.vis.headlight.diffuse[:] *= share


@hookimpl
def geoprior_looks() -> Iterable[LookSpec]:
    """What this package adds."""
    yield LookSpec(
        name="my-plugin",
        summary="the light is dimmed, in every episode by another share",
        config=MyPluginConfig,
        factory=MyPlugin,
    )
