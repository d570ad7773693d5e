"""Colours and light of an episode, drawn at random: the same for all its cameras and time steps.

A colour follows from the episode's seed and the body's name alone. Two bodies of one name are thus alike; a
plug-in that wants them unlike names them differently. No draw depends on which bodies a camera sees.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior.geometry.seeding import generator
from geoprior.options import Options
from geoprior.scene.ranges import ElevationRange, FractionRange, uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

FLOOR = "floor"
_BACKGROUND = "background"
_DARKEST = 0.05
"""Least value of a body's channels: pure black would show no shape."""
_KEPT = 1024
"""Episodes whose colours are kept: a training on fresh episodes draws single frames of many in turn."""


class AppearanceConfig(Options):
    """What colours and lights an episode may have."""

    ambient: FractionRange = Field(
        (0.35, 0.65), description="Share of the light that reaches every face; the rest comes from one side."
    )
    elevation: ElevationRange = Field(
        (30.0, 85.0), description="Of the light above the horizon, degrees; its azimuth is any."
    )
    ground: FractionRange = Field(
        (0.15, 0.95), description="Brightness of the floor, and of the background beyond it."
    )
    saturation: float = Field(
        0.2, ge=0.0, le=1.0, description="Largest saturation of floor and background: 0 gray, 1 pure."
    )
    contrast: float = Field(
        0.25,
        ge=0.0,
        le=0.4,
        description="A body's colour differs at least by this from the floor's in red, green or blue.",
    )


@dataclass(frozen=True)
class Appearance:
    """Of one episode.

    Attributes:
        config: What it was drawn from.
        seed: Of the episode; see `geoprior.render.clouds.Shot`.
        ambient: Share of the light that reaches every face.
        light: (3,) world direction to the light, its length the share of the light that comes from there.
        floor: (3,) red, green and blue of the floor, 0 to 1, as every colour here.
        background: (3,) where nothing is.
    """

    config: AppearanceConfig
    seed: int
    ambient: float
    light: FloatArray
    floor: FloatArray
    background: FloatArray

    def colour(self, body: str) -> FloatArray:
        """(3,) of the bodies of a name."""
        return self.floor if body == FLOOR else _draw_colour(self.config, self.seed, body)


@lru_cache(maxsize=_KEPT)
def draw_appearance(config: AppearanceConfig, seed: int) -> Appearance:
    """Draw light, floor and background of an episode; bodies get theirs when they are asked for."""
    rng = generator(seed, "appearance", "light")
    ambient = uniform(rng, config.ambient)
    elevation, azimuth = np.radians(uniform(rng, config.elevation)), rng.uniform(-np.pi, np.pi)
    across = np.cos(elevation)
    direction = np.array([across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)])
    return Appearance(
        config,
        seed,
        ambient,
        (1.0 - ambient) * direction,
        _dull(config, generator(seed, "appearance", FLOOR)),
        _dull(config, generator(seed, "appearance", _BACKGROUND)),
    )


@lru_cache(maxsize=4 * _KEPT)
def _draw_colour(config: AppearanceConfig, seed: int, body: str) -> FloatArray:
    rng, floor = generator(seed, "appearance", "body", body), draw_appearance(config, seed).floor
    while True:  # whatever the floor is, a contrast of 0.4 leaves a part of a channel
        colour = np.asarray(rng.uniform(_DARKEST, 1.0, 3))
        if np.abs(colour - floor).max() >= config.contrast:
            return colour


def _dull(config: AppearanceConfig, rng: np.random.Generator) -> FloatArray:
    hue, saturation = rng.random(), rng.uniform(0.0, config.saturation)
    return np.array(colorsys.hsv_to_rgb(hue, saturation, uniform(rng, config.ground)))
