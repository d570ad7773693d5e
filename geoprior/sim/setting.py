"""How a world is seen and paced, whatever its task and arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geoprior.geometry.camera import CamerasConfig
    from geoprior.sim.looks.look import Look


@dataclass(frozen=True)
class Setting:
    """What a task's world is told beside the arm.

    Attributes:
        cameras: Frame size, and fields of view of the hands' and the third camera.
        control_rate: Commands a second; divides 500.
        look: What the cameras see that physics does not feel.
    """

    cameras: CamerasConfig
    control_rate: int
    look: Look
