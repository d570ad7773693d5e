"""Options of the task `push`."""

from __future__ import annotations

from pydantic import Field

from geoprior.sim.tasks.timed import GoalOptions


class PushConfig(GoalOptions):
    """Options of the task `push`."""

    seconds: float = Field(15.0, gt=0.0, le=120.0, description="Time limit of a trial.")
    radius: float = Field(
        0.04, ge=0.02, le=0.06, description="Of the area; the cube's centre must come to lie over it, metres."
    )
    lift: float = Field(
        0.01,
        ge=0.005,
        le=0.10,
        description="Height of the cube's lowest corner that counts as lifted, metres.",
    )
