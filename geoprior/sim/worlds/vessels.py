"""A bottle and a can of plain geometry that stand still, also on each other.

robosuite's own `BottleObject` and `CanObject` are meshes. With one contact point for a pair of geometries,
which the Robotiq's linkage needs (see `geoprior.sim.worlds.tabletop`), a mesh or a cylinder on a flat face
rocks for ever; two boxes keep all their contact points. So each vessel stands on, and carries with, a box
inside its round wall: as tall as the wall and a little more, its edges hidden just below the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from geoprior.sim.backend import prepare_robosuite

prepare_robosuite()

from robosuite.models.objects import CompositeObject  # noqa: E402

BOTTLE_RADIUS = 0.027
BOTTLE_BODY_HEIGHT = 0.085
BOTTLE_HEIGHT = 0.125
BOTTLE_COLOUR = (0.10, 0.42, 0.16, 1.0)
BOTTLE_CAP_COLOUR = (0.93, 0.93, 0.88, 1.0)

CAN_RADIUS = 0.034
CAN_HEIGHT = 0.075
CAN_COLOUR = (0.78, 0.10, 0.10, 1.0)
CAN_RIM_COLOUR = (0.80, 0.81, 0.83, 1.0)

DENSITY = 350.0
"""Kilogrammes a cubic metre: a bottle of 70 g, a can of 95 g."""

FRICTION = (1.0, 0.02, 0.0001)
"""Sliding, torsional in metres (a finger pad touches a round wall along a line, the simulator at a point),
and rolling."""

_NO_MASS = 1e-3
_LEDGE = 0.0005
"""Metres by which the box is longer than the wall at either end."""


@dataclass(frozen=True)
class _Part:
    """A piece of a vessel: an upright cylinder, or a square box of half side ``radius``."""

    radius: float
    bottom: float
    top: float
    shape: str = "cylinder"
    obj_type: str = "visual"
    colour: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    density: float = _NO_MASS


def make_bottle() -> Any:
    """A body with a slim neck; the origin is in the middle of its foot, z up. All yaws are alike."""
    shoulder = BOTTLE_BODY_HEIGHT + 0.010
    cap = BOTTLE_HEIGHT - 0.014
    parts = [
        *_standing(BOTTLE_RADIUS, BOTTLE_BODY_HEIGHT),
        _Part(0.012, BOTTLE_BODY_HEIGHT, BOTTLE_HEIGHT, obj_type="collision", density=DENSITY),
        _Part(BOTTLE_RADIUS, 0.0, BOTTLE_BODY_HEIGHT, colour=BOTTLE_COLOUR),
        _Part(0.020, BOTTLE_BODY_HEIGHT, shoulder, colour=BOTTLE_COLOUR),
        _Part(0.011, shoulder, cap, colour=BOTTLE_COLOUR),
        _Part(0.013, cap, BOTTLE_HEIGHT, colour=BOTTLE_CAP_COLOUR),
    ]
    return _vessel("bottle", parts, BOTTLE_RADIUS, BOTTLE_HEIGHT)


def make_can() -> Any:
    """A wide can with bright rims; the origin is in the middle of its foot, z up. All yaws are alike."""
    parts = [
        *_standing(CAN_RADIUS, CAN_HEIGHT),
        _Part(CAN_RADIUS - 0.002, 0.0, 0.005, colour=CAN_RIM_COLOUR),
        _Part(CAN_RADIUS, 0.005, CAN_HEIGHT - 0.005, colour=CAN_COLOUR),
        _Part(CAN_RADIUS - 0.002, CAN_HEIGHT - 0.005, CAN_HEIGHT, colour=CAN_RIM_COLOUR),
    ]
    return _vessel("can", parts, CAN_RADIUS, CAN_HEIGHT)


def _standing(radius: float, height: float) -> list[_Part]:
    """The wall, and the box that carries."""
    half_side = 0.97 * radius / np.sqrt(2.0)
    return [
        _Part(radius, _LEDGE, height - _LEDGE, obj_type="collision", density=DENSITY),
        _Part(half_side, 0.0, height, shape="box", obj_type="collision"),
    ]


def _vessel(name: str, parts: Sequence[_Part], radius: float, height: float) -> Any:
    return CompositeObject(
        name=name,
        total_size=[radius, radius, height / 2.0],
        geom_types=[part.shape for part in parts],
        geom_sizes=[_size(part) for part in parts],
        geom_locations=[[0.0, 0.0, (part.bottom + part.top) / 2.0] for part in parts],
        geom_rgbas=[part.colour for part in parts],
        geom_frictions=[FRICTION for _ in parts],
        geom_condims=[4 for _ in parts],
        density=[part.density for part in parts],
        obj_types=[part.obj_type for part in parts],
        locations_relative_to_center=True,
    )


def _size(part: _Part) -> list[float]:
    half_height = (part.top - part.bottom) / 2.0
    sides = [part.radius] * 2 if part.shape == "box" else [part.radius]
    return [*sides, half_height]
