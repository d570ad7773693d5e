"""What tasks share: a time limit, a success that must hold, and a cube with a goal."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field, model_validator

from geoprior.options import Options

_ROOM = 1.25
"""The longer side of the range over the gap, at least: at most some thirty draws for a placement."""


class TimedOptions(Options):
    """How long a trial may take, and how long its goal must hold."""

    seconds: float = Field(10.0, gt=0.0, le=120.0, description="Time limit of a trial.")
    sustain: float = Field(
        0.2, ge=0.0, le=5.0, description="Seconds for which success must hold without a break."
    )


class GoalOptions(TimedOptions):
    """A cube and a goal, each anywhere in a rectangle on the table, and apart from each other.

    With the widest range, cube and goal still lie in the third camera's view and within every arm's reach.
    """

    range_x: float = Field(
        0.09, ge=0.0, le=0.09, description="Cube and goal lie within +- this along x, metres."
    )
    range_y: float = Field(
        0.15, ge=0.0, le=0.15, description="Cube and goal lie within +- this along y, metres."
    )
    gap: float = Field(
        0.13, ge=0.08, le=0.25, description="From the cube's centre to the goal's, at least, metres."
    )

    @model_validator(mode="after")
    def _leaves_room(self) -> GoalOptions:
        if 2.0 * max(self.range_x, self.range_y) < _ROOM * self.gap:
            raise ValueError(
                f"range_x {self.range_x} and range_y {self.range_y} leave no room for a gap of {self.gap} m: "
                f"twice the longer one must be at least {_ROOM} x gap"
            )
        return self


@dataclass(frozen=True)
class TimedTask:
    """Those parts of `geoprior.sim.tasks.task.Task` that are the same for all."""

    config: TimedOptions

    @property
    def seconds(self) -> float:
        """Time limit of a trial."""
        return self.config.seconds

    @property
    def sustain(self) -> float:
        """Seconds for which success must hold."""
        return self.config.sustain
