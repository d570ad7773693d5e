"""The look of the demonstrations: one colour for each thing, soft light, cameras where they belong."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior import LookSpec, hookimpl
from geoprior.options import Options

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

    import mujoco
    import numpy as np


class PlainConfig(Options):
    """No options."""


@dataclass(frozen=True)
class PlainLook:
    """See `geoprior.sim.looks.look.Look`: changes nothing."""

    config: PlainConfig

    def furnish(self, world: ET.Element) -> None:
        """Nothing is added."""

    def dress(self, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator) -> None:
        """Everything stays as it is."""


@hookimpl
def geoprior_looks() -> Iterable[LookSpec]:
    """One look."""
    yield LookSpec(name="plain", summary="as the demonstrations look", config=PlainConfig, factory=PlainLook)
