"""How the simulated world looks: colours, textures, lights, a camera, things that stand about.

A look changes pictures and nothing else: the same initial state and the same commands give the same states in
every look, to the bit, so that trials can be compared in pairs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

    import mujoco
    import numpy as np


class Look(Protocol):
    """A way to look at the same physics."""

    def furnish(self, world: ET.Element) -> None:
        """Add what must be there before the model is compiled: textures, materials, and things to see.

        Args:
            world: Root of the MuJoCo XML. Geometries that are added belong to group 1 and collide with
                nothing (``contype`` and ``conaffinity`` 0).
        """
        ...

    def dress(self, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator) -> None:
        """Change the appearance for one episode, after every reset.

        Args:
            model: Looks as it was compiled. What `geoprior.sim.appearance.FIELDS` names may be written, and
                the places of the world's geometries that collide with nothing; it is undone before the next
                episode.
            data: In the initial state, to be read.
            rng: Of the initial state's seed.
        """
        ...
