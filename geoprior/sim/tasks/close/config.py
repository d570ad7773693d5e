"""Options of the task `close`."""

from __future__ import annotations

from pydantic import Field

from geoprior.sim.tasks.door.config import DoorConfig


class CloseConfig(DoorConfig):
    """Options of the task `close`: those of `door`, and how far the door is open at first.

    With the widest range, the door is in the third camera's view and its panel within every arm's reach.
    """

    range_angle: float = Field(
        0.15, ge=0.0, le=0.15, description="It begins open by 0.45 radians within +- this."
    )
    angle: float = Field(
        0.03, ge=0.01, le=0.1, description="Angle of the hinge below which the door counts as shut, radians."
    )
    sustain: float = Field(
        0.5, ge=0.0, le=5.0, description="Seconds for which success must hold without a break."
    )
