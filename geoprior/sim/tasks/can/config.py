"""Options of the task `can`."""

from __future__ import annotations

from pydantic import Field

from geoprior.sim.tasks.timed import TimedOptions


class CanConfig(TimedOptions):
    """Options of the task `can`.

    With the widest range, the can is in the third camera's view and within every arm's reach.
    """

    range_x: float = Field(
        0.10, ge=0.0, le=0.10, description="The can stands within +- this along x, metres."
    )
    range_y: float = Field(
        0.15, ge=0.0, le=0.15, description="The can stands within +- this along y, metres."
    )
    lift: float = Field(
        0.05, ge=0.02, le=0.10, description="Height of the can's lowest point that counts, metres."
    )
