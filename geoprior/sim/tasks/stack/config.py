"""Options of the task `stack`."""

from __future__ import annotations

from pydantic import Field

from geoprior.sim.tasks.timed import GoalOptions


class StackConfig(GoalOptions):
    """Options of the task `stack`; the goal is the other cube."""

    # Room for an open finger between the cubes, whatever their yaws.
    gap: float = Field(
        0.13, ge=0.11, le=0.20, description="From one cube's centre to the other's, at least, metres."
    )
    seconds: float = Field(15.0, gt=0.0, le=120.0, description="Time limit of a trial.")
    sustain: float = Field(
        0.5, ge=0.0, le=5.0, description="Seconds for which success must hold without a break."
    )
