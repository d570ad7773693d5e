"""What the checks try plug-ins on: scenes with every built-in primitive, in the default ranges."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.seeding import generator
from geoprior.hooks.manager import Plugins, plugins
from geoprior.options import Choice
from geoprior.scene.config import SceneConfig
from geoprior.scene.scene import Scene, draw_scene

if TYPE_CHECKING:
    import numpy as np

    from geoprior.hooks.types import MotionSpec, Primitive
    from geoprior.scene.config import OtherConfig
    from geoprior.scene.mesh import Mesh

CAMERAS = CamerasConfig(height=40, width=52)
"""A frame whose width is no whole number of bytes."""


@lru_cache(maxsize=1)
def builtins() -> Plugins:
    """A manager that knows the built-ins and nobody else."""
    found = Plugins()
    found.load_builtins()
    return found


def scene(number: int, spec: MotionSpec | None = None) -> Scene:
    """A scene as a motion's spec wants it; without one, with a hand and an object.

    The built-in primitives take turns with the number.
    """
    names = builtins().names("primitive")
    rng = generator(number, "conformance", "scene")
    mesh = _solid(Choice(name=names[number % len(names)]), rng)
    if spec is None:
        return draw_scene(SceneConfig(), CAMERAS, mesh, rng)
    others = {name: (where, _other(where, rng)) for name, where in spec.others(spec.config()).items()}
    return draw_scene(SceneConfig(), CAMERAS, mesh, rng, spec.hands, others)


def _other(where: OtherConfig, rng: np.random.Generator) -> Mesh:
    """One of the solids that a further object may be."""
    choices = where.primitives or [Choice(name=name) for name in builtins().names("primitive")]
    return _solid(choices[int(rng.integers(len(choices)))], rng)


def _solid(choice: Choice, rng: np.random.Generator) -> Mesh:
    """A solid of a built-in primitive, or of one that a package adds."""
    known = builtins() if choice.name in builtins().names("primitive") else plugins()
    primitive: Primitive = known.build("primitive", choice)
    return primitive.sample(rng)
