"""Things that have no part in the task stand about on the table."""

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

TABLE_HEIGHT = 0.8
SHAPES = (
    ("box", (0.030, 0.020, 0.025)),
    ("cylinder", (0.022, 0.040)),
    ("sphere", (0.026,)),
    ("ellipsoid", (0.035, 0.022, 0.022)),
    ("box", (0.015, 0.045, 0.012)),
    ("cylinder", (0.034, 0.018)),
    ("box", (0.022, 0.022, 0.050)),
    ("ellipsoid", (0.024, 0.024, 0.040)),
)
"""MuJoCo's types and sizes of what may stand about, metres."""

LOW, HIGH = np.array([-0.30, -0.36]), np.array([0.22, 0.36])
"""Where they stand, workspace frame, metres: the part of the table that the third camera sees."""

CLEARANCE = 0.05
"""Metres between the outlines of two things, at least."""

_AWAY = -1.0
"""Metres: height of what does not appear, far under the floor."""


class DistractorsConfig(Options):
    """Options of the look `distractors`."""

    count: int = Field(4, ge=1, le=len(SHAPES), description="Things that stand about.")


@dataclass(frozen=True)
class Distractors:
    """See `geoprior.sim.looks.look.Look`: solids of several shapes and colours, in random places.

    They are to be seen and not to be touched: a hand that goes there passes through them. None stands where
    an object of the task is at the start.
    """

    config: DistractorsConfig

    def furnish(self, world: ET.Element) -> None:
        """Add every shape to the world."""
        body = world.find("./worldbody")
        assert body is not None
        for number, (kind, sizes) in enumerate(SHAPES):
            geom = {"name": _name(number), "type": kind, "size": " ".join(map(str, sizes))}
            unseen = {"contype": "0", "conaffinity": "0", "group": "1", "pos": f"0 0 {TABLE_HEIGHT}"}
            ET.SubElement(body, "geom", {**geom, **unseen})

    def dress(self, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator) -> None:
        """Choose some of the shapes, and their places and colours."""
        chosen = set(rng.permutation(len(SHAPES))[: self.config.count].tolist())
        taken = _outlines(model, data)
        for number in range(len(SHAPES)):
            geom = model.geom(_name(number)).id
            if number not in chosen:
                model.geom_pos[geom, 2] = _AWAY
                continue
            radius = float(np.hypot(*model.geom_aabb[geom, 3:5]))
            place = _free_place(rng, radius, taken)
            taken.append((place, radius))
            yaw = rng.uniform(-np.pi, np.pi)
            model.geom_pos[geom] = [*place, TABLE_HEIGHT + model.geom_aabb[geom, 5]]
            model.geom_quat[geom] = np.cos(yaw / 2.0), 0.0, 0.0, np.sin(yaw / 2.0)
            model.geom_rgba[geom] = *colorsys.hsv_to_rgb(*rng.uniform([0.0, 0.3, 0.4], [1.0, 1.0, 0.9])), 1.0


def _name(number: int) -> str:
    return f"distractor{number}"


def _outlines(model: mujoco.MjModel, data: mujoco.MjData) -> list[tuple[FloatArray, float]]:
    """Centres (2,) and radii of circles on the table around whatever stands on it, the arm left out."""
    return [(data.geom_xpos[geom, :2].copy(), float(model.geom_rbound[geom])) for geom in object_geoms(model)]


def _free_place(rng: np.random.Generator, radius: float, taken: list[tuple[FloatArray, float]]) -> FloatArray:
    """(2,) a place apart from what is taken; the best of many where the table is full."""
    places: FloatArray = rng.uniform(LOW, HIGH, (200, 2))
    gaps = [np.linalg.norm(places - centre, axis=1) - size - radius for centre, size in taken]
    room = np.min(gaps, axis=0) if gaps else np.full(len(places), np.inf)
    free = np.flatnonzero(room > CLEARANCE)
    place: FloatArray = places[free[0] if len(free) else int(np.argmax(room))]
    return place


@hookimpl
def geoprior_looks() -> Iterable[LookSpec]:
    """One look."""
    yield LookSpec(
        name="distractors",
        summary="things that have no part in the task stand about on the table",
        config=DistractorsConfig,
        factory=Distractors,
    )
