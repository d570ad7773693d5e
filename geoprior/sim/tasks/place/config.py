"""Options of the task `place`."""

from __future__ import annotations

from pydantic import Field

from geoprior.sim.tasks.timed import GoalOptions


class PlaceConfig(GoalOptions):
    """Options of the task `place`."""

    # Room for an open finger between cube and wall, whatever the yaws.
    gap: float = Field(
        0.15, ge=0.15, le=0.20, description="From the cube's centre to the enclosure's, at least, metres."
    )
    seconds: float = Field(15.0, gt=0.0, le=120.0, description="Time limit of a trial.")
