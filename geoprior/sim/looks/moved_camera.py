"""The third camera stands a little elsewhere, in every episode in another place."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from geoprior import LookSpec, hookimpl
from geoprior.options import Options

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

    import mujoco

CAMERA = "third"


class MovedCameraConfig(Options):
    """Options of the look `moved-camera`."""

    distance: float = Field(0.04, ge=0.0, le=0.15, description="Metres by which the camera is moved.")
    angle: float = Field(3.0, ge=0.0, le=15.0, description="Degrees by which the camera is turned.")


@dataclass(frozen=True)
class MovedCamera:
    """See `geoprior.sim.looks.look.Look`: a step in a random direction and a turn about a random axis."""

    config: MovedCameraConfig

    def furnish(self, world: ET.Element) -> None:
        """Nothing is added."""

    def dress(self, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator) -> None:  # noqa: ARG002
        """Move and turn the third camera."""
        from scipy.spatial.transform import Rotation

        step, axis = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
        camera = model.camera(CAMERA).id
        model.cam_pos[camera] += self.config.distance * step
        w, x, y, z = model.cam_quat[camera]
        turn = Rotation.from_rotvec(np.radians(self.config.angle) * axis)
        x, y, z, w = (turn * Rotation.from_quat([x, y, z, w])).as_quat()
        model.cam_quat[camera] = w, x, y, z


@hookimpl
def geoprior_looks() -> Iterable[LookSpec]:
    """One look."""
    yield LookSpec(
        name="moved-camera",
        summary="the third camera stands and looks a little differently in every episode",
        config=MovedCameraConfig,
        factory=MovedCamera,
    )
