"""When an episode is over, and how it went."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geoprior.sim.environment import Environment

TIME_OUT = "time-out"
UNSTABLE = "unstable physics"
BAD_ACTION = "NaN action"
GAVE_UP = "expert ended"
"""Reasons of failure beside the task's own (such as ``dropped``); an empty reason is success."""


class Judge:
    """Watches one episode. Success counts when it has held for the task's ``sustain`` without a break.

    An episode cannot be won at its start: `Environment.reset` refuses such a state, and the first look of
    a judge comes after the first command.

    Args:
        env: Reset.
    """

    def __init__(self, env: Environment) -> None:
        self._env = env
        self._needed = max(1, math.ceil(env.task.sustain * env.control_rate - 1e-9))
        self._held = 0

    @property
    def waits(self) -> bool:
        """Whether there is success and it has not held for long enough."""
        return 0 < self._held < self._needed

    def look(self) -> str | None:
        """None while undecided, an empty string on success, else the reason of failure. Call once a step."""
        reason = self._env.world.failure()
        if reason:
            return reason
        self._held = self._held + 1 if self._env.world.succeeded() else 0
        return "" if self._held >= self._needed else None
