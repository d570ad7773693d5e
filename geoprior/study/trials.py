"""One rollout of one policy, as a line of ``rollouts.jsonl``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config

from geoprior.errors import DataError

Count = Annotated[int, Field(ge=0)]


@with_config(ConfigDict(extra="ignore", allow_inf_nan=False))
@dataclass(frozen=True)
class Trial:
    """One rollout.

    Attributes:
        task: Registered name of the task.
        robot: Registered name of the robot.
        condition: What the policy started from, for example ``prior`` or ``scratch``.
        training_seed: Seed of the training that gave the policy.
        epoch: Fine-tuning epochs done (one epoch: one random time step of every demonstration).
        state_seed: Names the initial state; every condition meets the same ones.
        success: Whether the task was done.
        reason: Why it failed, in a few words; empty on success.
        steps: Control steps taken.
        seconds: Simulated time of the rollout; does not enter the results.
        film: Path of its film within the run folder, or empty.
        look: Registered name of the look that the cameras saw.
    """

    task: str
    robot: str
    condition: str
    training_seed: Count
    epoch: Count
    state_seed: Count
    success: Annotated[bool, Field(strict=True)]
    reason: str
    steps: Count
    seconds: float
    film: Annotated[str, Field(pattern=r"^(films/[A-Za-z0-9._-]+\.webm)?$")] = ""
    look: str = "plain"

    @property
    def key(self) -> tuple[str, str, str, str, int, int, int]:
        """What no two trials of a run share; also their order."""
        return (*self.scene, self.condition, self.training_seed, self.epoch, self.state_seed)

    @property
    def scene(self) -> tuple[str, str, str]:
        """Robot, task and look: only trials that agree in them are compared."""
        return self.robot, self.task, self.look


_LINE = TypeAdapter(Trial)


def read_rollouts(path: Path) -> tuple[Trial, ...]:
    """Read ``rollouts.jsonl``, in the order of its lines.

    Raises:
        DataError: The file is missing, a line is damaged or cut off, or a trial stands there twice; the
            message names the line.
    """
    hint = f"delete {path.name} and run `geoprior evaluate` on this run folder again"
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror or error})", hint) from error
    trials: list[Trial] = []
    line_of_key: dict[tuple[object, ...], int] = {}
    for number, line in enumerate(lines, start=1):
        trial = _parse(line, f"{path}, line {number}", hint)
        first = line_of_key.setdefault(trial.key, number)
        if first != number:
            raise DataError(f"{path}, line {number}: the same trial as on line {first}", hint)
        trials.append(trial)
    return tuple(trials)


def _parse(line: bytes, where: str, hint: str) -> Trial:
    try:
        return _LINE.validate_json(line)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in fault["loc"])
        raise DataError(f"{where}: {f'{field}: ' if field else ''}{fault['msg']}", hint) from error
