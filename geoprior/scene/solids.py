"""Building blocks of primitives: unit shapes, and how a drawn size turns them into a solid.

A unit shape has a base of diameter 1 and a height of 1, so that a primitive's plug-in says only what is
special about it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior.options import Options
from geoprior.scene.mesh import Mesh, centred, convex_mesh, scaled
from geoprior.scene.ranges import LengthRange, SideCountRange, uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

ROUND_SIDES = 64
SPHERE_POINTS = 600


class StretchOptions(Options):
    """Stretching along the axes."""

    stretch: float = Field(
        0.2, ge=0.0, le=0.9, description="Each axis is stretched by a factor within 1 plus or minus this."
    )
    stretched: float = Field(0.5, ge=0.0, le=1.0, description="Share of the objects that are stretched.")


class SolidOptions(StretchOptions):
    """Size and stretch of a solid with a base and a height."""

    width: LengthRange = Field((0.02, 0.12), description="Diameter of the base's circumcircle, metres.")
    height: LengthRange = Field((0.02, 0.12), description="Height, metres.")


class PolygonOptions(SolidOptions):
    """A solid on a polygon."""

    sides: SideCountRange = Field((3, 8), description="Corners of the base.")
    distortion: float = Field(
        0.15, ge=0.0, le=0.25, description="How far the regular base is distorted, as a share of its radius."
    )


def polygon(sides: int, distortion: float, rng: np.random.Generator) -> FloatArray:
    """A regular polygon, slightly distorted.

    Args:
        sides: Number of corners.
        distortion: Each corner's radius varies by up to this share, its angle by this share of half a side.
        rng: Draws the distortion.

    Returns:
        (sides, 2) corners, counter-clockwise, on a circle of diameter 1 before the distortion.
    """
    angles = 2.0 * np.pi / sides * (np.arange(sides) + 0.5 * distortion * rng.uniform(-1.0, 1.0, sides))
    radii = 0.5 * (1.0 + distortion * rng.uniform(-1.0, 0.0, sides))
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


def circle() -> FloatArray:
    """(64, 2) corners of a fine regular polygon of diameter 1."""
    angles = 2.0 * np.pi / ROUND_SIDES * np.arange(ROUND_SIDES)
    return 0.5 * np.column_stack([np.cos(angles), np.sin(angles)])


def frustum(base: FloatArray, top: float) -> Mesh:
    """A base and its copy shrunk by ``top`` one unit higher: 1 is a prism, 0 comes to a point."""
    low = np.column_stack([base, np.zeros(len(base))])
    if top == 0.0:
        return convex_mesh(np.vstack([low, [[0.0, 0.0, 1.0]]]))
    high = np.column_stack([top * base, np.ones(len(base))])
    return convex_mesh(np.vstack([low, high]))


@lru_cache(maxsize=1)
def unit_cylinder() -> Mesh:
    """A cylinder of diameter 1 and height 1."""
    return frustum(circle(), 1.0)


@lru_cache(maxsize=1)
def unit_cone() -> Mesh:
    """A cone of diameter 1 and height 1."""
    return frustum(circle(), 0.0)


@lru_cache(maxsize=1)
def unit_sphere() -> Mesh:
    """A sphere of diameter 1: the hull of a Fibonacci lattice."""
    index = np.arange(SPHERE_POINTS) + 0.5
    z = 1.0 - 2.0 * index / SPHERE_POINTS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * index
    ring = np.sqrt(1.0 - z**2)
    return convex_mesh(0.5 * np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z]))


def solid(
    unit: Mesh,
    size: tuple[float, float, float],
    options: StretchOptions,
    rng: np.random.Generator,
    **drawn: float,
) -> Mesh:
    """Give a unit shape its size and perhaps a stretch, and centre its bounding box on the origin.

    Args:
        unit: The shape of unit size.
        size: Factors along x, y and z, metres.
        options: The stretch.
        rng: Draws the stretch.
        drawn: What the primitive has drawn, for the header.
    """
    factors = np.ones(3)
    if rng.random() < options.stretched:
        factors = rng.uniform(1.0 - options.stretch, 1.0 + options.stretch, 3)
    mesh = centred(scaled(unit, np.asarray(size) * factors))
    return replace(
        mesh,
        parameters={
            **drawn,
            **dict(zip(("stretch_x", "stretch_y", "stretch_z"), map(float, factors), strict=True)),
        },
    )


def sized_solid(unit: Mesh, options: SolidOptions, rng: np.random.Generator, **drawn: float) -> Mesh:
    """`solid` with a width and a height drawn from the options."""
    width, height = uniform(rng, options.width), uniform(rng, options.height)
    return solid(unit, (width, width, height), options, rng, width=width, height=height, **drawn)
