"""Options of the task `pick`."""

from __future__ import annotations

from pydantic import Field

from geoprior.sim.tasks.timed import TimedOptions


class PickConfig(TimedOptions):
    """Options of the task `pick`."""

    range_x: float = Field(0.10, ge=0.0, le=0.15, description="The cube lies within +- this along x, metres.")
    range_y: float = Field(0.15, ge=0.0, le=0.20, description="The cube lies within +- this along y, metres.")
    lift: float = Field(
        0.05, ge=0.02, le=0.15, description="Height of the cube's underside that counts, metres."
    )
