"""Other colours and textures: table, floor and the task's objects."""

from __future__ import annotations

import colorsys
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import LookSpec, hookimpl
from geoprior.options import Options
from geoprior.sim.looks._objects import object_geoms

if TYPE_CHECKING:
    import mujoco
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

SURFACES = {
    "table_visual": ("light-wood", "blue-wood", "gray-felt", "dark-wood"),
    "floor_visual": ("wood-tiles", "light-gray-floor-tile", "white-bricks"),
}
"""Pictures of robosuite's that each surface may get."""

REPEATS = {"table_visual": 2, "floor_visual": 12}

_TEXTURED = (0.5, 0.5, 0.5, 1.0)
"""MuJoCo takes a material's own colour where a geometry has this one."""


class RepaintedConfig(Options):
    """Options of the look `repainted`."""

    hue: float = Field(
        0.08, ge=0.0, le=0.5, description="Hues of the objects turn by up to this share of the colour circle."
    )
    shade: float = Field(
        0.3, ge=0.0, le=0.9, description="Saturation and brightness of the objects fall by up to this share."
    )


@dataclass(frozen=True)
class Repainted:
    """See `geoprior.sim.looks.look.Look`. All objects of an episode turn by the same hue."""

    config: RepaintedConfig

    def furnish(self, world: ET.Element) -> None:
        """Add the surfaces' materials."""
        from robosuite.models import assets_root

        assets = world.find("./asset")
        assert assets is not None
        for surface, pictures in SURFACES.items():
            for picture in pictures:
                name, repeat = _name(surface, picture), str(REPEATS[surface])
                file = f"{assets_root}/textures/{picture}.png"
                ET.SubElement(assets, "texture", {"name": name, "type": "2d", "file": file})
                material = {"name": name, "texture": name, "texrepeat": f"{repeat} {repeat}", "specular": "0"}
                ET.SubElement(assets, "material", material)

    def dress(self, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator) -> None:  # noqa: ARG002
        """Choose a picture for each surface, and turn the objects' colours."""
        for surface, pictures in SURFACES.items():
            geom = model.geom(surface).id
            model.geom_matid[geom] = model.material(_name(surface, str(rng.choice(pictures)))).id
            model.geom_rgba[geom] = _TEXTURED
        turn = rng.uniform(-self.config.hue, self.config.hue)
        saturation, value = 1.0 - rng.uniform(0.0, self.config.shade, 2)
        for geom in object_geoms(model):
            if model.geom_matid[geom] >= 0:
                continue
            model.geom_rgba[geom, :3] = _turned(model.geom_rgba[geom, :3], turn, saturation, value)


def _name(surface: str, picture: str) -> str:
    return f"{surface}-{picture}"


def _turned(colour: FloatArray, turn: float, saturation: float, value: float) -> tuple[float, float, float]:
    hue, of_saturation, of_value = colorsys.rgb_to_hsv(*colour.tolist())
    return colorsys.hsv_to_rgb((hue + turn) % 1.0, of_saturation * saturation, of_value * value)


@hookimpl
def geoprior_looks() -> Iterable[LookSpec]:
    """One look."""
    yield LookSpec(
        name="repainted",
        summary="table and floor have pictures instead of one colour, and the objects other colours",
        config=RepaintedConfig,
        factory=Repainted,
    )
