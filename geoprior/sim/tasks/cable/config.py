"""Options of the task `cable`."""

from __future__ import annotations

from pydantic import Field

from geoprior.sim.tasks.timed import TimedOptions


class CableConfig(TimedOptions):
    """Options of the task `cable`.

    With the widest range, cable and area are in the third camera's view and within every arm's reach. With
    the narrowest, there is still room for the largest area, gap and bend.
    """

    range_x: float = Field(
        0.09, ge=0.0, le=0.09, description="Plug and area lie within +- this along x, metres."
    )
    range_y: float = Field(
        0.14, ge=0.10, le=0.14, description="Plug and area lie within +- this along y, metres."
    )
    gap: float = Field(
        0.12, ge=0.10, le=0.16, description="From the plug's middle to the area's, at least, metres."
    )
    bend: float = Field(
        80.0,
        ge=0.0,
        le=120.0,
        description="The cable turns by no more than this from one end to the other, degrees.",
    )
    radius: float = Field(
        0.04, ge=0.02, le=0.05, description="Of the area; the plug's middle must lie over it, metres."
    )
    seconds: float = Field(15.0, gt=0.0, le=120.0, description="Time limit of a trial.")
    sustain: float = Field(
        0.5, ge=0.0, le=5.0, description="Seconds for which success must hold without a break."
    )
