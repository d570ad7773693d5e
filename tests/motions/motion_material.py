"""Planned episodes for any motion, primitive and size of frame."""

from __future__ import annotations

from functools import cache

from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import stage_episode

MOTIONS = ("pick", "place", "push")
PRIMITIVES = ("cone", "cylinder", "prism", "pyramid", "sphere", "truncated-cone", "truncated-pyramid")
ROOT_SEED = 11


@cache
def recipe(primitive, steps):
    return GenerateConfig(fps=steps, seconds=1.0, primitives=[Choice(name=primitive)])


def stage(motion, index, steps=40, size=(96, 96), **options):
    """One planned episode, scene and trajectory; the primitives take turns."""
    config = recipe(PRIMITIVES[index % len(PRIMITIVES)], steps)
    cameras = CamerasConfig(height=size[0], width=size[1])
    return stage_episode(config, cameras, ROOT_SEED, Choice(name=motion, options=options), index)
