"""Options of the task `door`."""

from __future__ import annotations

from pydantic import Field

from geoprior.sim.tasks.timed import TimedOptions


class DoorConfig(TimedOptions):
    """Options of the task `door`.

    With the widest range, the door is in the third camera's view and its handle within every arm's reach.
    """

    range_x: float = Field(
        0.08, ge=0.0, le=0.08, description="The door stands within +- this along x, metres."
    )
    range_y: float = Field(
        0.075, ge=0.0, le=0.075, description="The door stands within +- this along y, metres."
    )
    range_yaw: float = Field(27.0, ge=0.0, le=27.0, description="It is turned within +- this, degrees.")
    angle: float = Field(0.3, ge=0.1, le=0.4, description="Angle of the hinge that counts as open, radians.")
    seconds: float = Field(15.0, gt=0.0, le=120.0, description="Time limit of a trial.")
