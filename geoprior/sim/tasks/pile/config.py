"""Options of the task `pile`."""

from __future__ import annotations

from pydantic import Field

from geoprior.sim.tasks.timed import TimedOptions


class PileConfig(TimedOptions):
    """Options of the task `pile`.

    With the widest range, bottle and can are in the third camera's view and within every arm's reach. With
    the narrowest, the largest gap still leaves room for both.
    """

    range_x: float = Field(
        0.10, ge=0.0, le=0.10, description="Bottle and can stand within +- this along x, metres."
    )
    range_y: float = Field(
        0.15, ge=0.11, le=0.15, description="Bottle and can stand within +- this along y, metres."
    )
    gap: float = Field(
        0.15, ge=0.14, le=0.17, description="From the bottle's middle to the can's, at least, metres."
    )
    seconds: float = Field(15.0, gt=0.0, le=120.0, description="Time limit of a trial.")
    sustain: float = Field(
        0.5, ge=0.0, le=5.0, description="Seconds for which success must hold without a break."
    )
