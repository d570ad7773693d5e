"""``rollouts.jsonl``: one line a trial, written as the trials end, in order when all are there."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config

from geoprior.errors import DataError
from geoprior.files import write_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

Count = Annotated[int, Field(ge=0)]
FilmPath = Annotated[str, Field(pattern=r"^(films/[^/\\\x00-\x1f]+\.webm)?$")]
"""A file in the folder of films, and nowhere else; conditions have their names in any alphabet."""


@with_config(ConfigDict(extra="ignore", allow_inf_nan=False))
@dataclass(frozen=True, order=True)
class TrialRecord:
    """One trial.

    Attributes:
        robot: Registered name.
        task: Registered name.
        condition: What the policy was made from, for example ``scratch`` or ``prior``.
        training_seed: Of its fine-tuning.
        epoch: Of the checkpoint.
        state_seed: Initial state.
        success: Whether the goal was reached and held.
        reason: Of the failure; empty on success. ``time-out``, ``unstable physics``, ``NaN action``, or the
            task's own, such as ``dropped``.
        steps: Commands carried out.
        seconds: Simulated time of the episode; wall time is not recorded, so that a record is the same
            whoever made it.
        film: Path of its film within the run folder, or empty.
        look: Registered name of the look that the cameras saw.
        weights: The first digits of the SHA-256 of the policy's weights; empty where there are none.
    """

    robot: str
    task: str
    condition: str
    training_seed: Count
    epoch: Count
    state_seed: Count
    success: Annotated[bool, Field(strict=True)]
    reason: str
    steps: Count
    seconds: float
    film: FilmPath = ""
    look: str = "plain"
    weights: Annotated[str, Field(pattern="^[0-9a-f]{0,64}$")] = ""

    @property
    def key(self) -> tuple[str, int, int, int]:
        """What tells the trials of one scene apart."""
        return self.condition, self.training_seed, self.epoch, self.state_seed

    @property
    def scene(self) -> tuple[str, str, str]:
        """Robot, task and look: only trials that agree in them are compared."""
        return self.robot, self.task, self.look

    def line(self) -> bytes:
        """The record as a line of JSON."""
        return json.dumps(asdict(self), sort_keys=True, allow_nan=False).encode() + b"\n"


def read_records(path: Path) -> list[TrialRecord]:
    """Read the file as far as it is whole; an unfinished last line, left by a kill, is cut off.

    Raises:
        DataError: Another line is not a record; it is named.
    """
    if not path.exists():
        return []
    content = path.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]
    if len(whole) < len(content):
        with path.open("r+b") as file:
            file.truncate(len(whole))
    hint = f"delete {path} and run the same command again"
    return [
        parse_record(line, f"{path}:{number}", hint)
        for number, line in enumerate(whole.splitlines(), start=1)
    ]


def append_record(path: Path, record: TrialRecord) -> None:
    """Add a line and make sure that it is on the disk."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab") as file:
            file.write(record.line())
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise DataError(f"{path}: cannot be written ({error.strerror or error})", "make room") from error


def write_records(path: Path, records: Iterable[TrialRecord]) -> None:
    """Replace the file by the records in order."""
    write_bytes(path, b"".join(record.line() for record in sorted(records)))


def parse_record(line: bytes, where: str, hint: str) -> TrialRecord:
    """Read one line; keys of a later version are ignored.

    Raises:
        DataError: It is not JSON, or a field is missing or out of range; the message says where.
    """
    try:
        return _LINE.validate_json(line)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in fault["loc"])
        raise DataError(f"{where}: {f'{field}: ' if field else ''}{fault['msg']}", hint) from error


_LINE = TypeAdapter(TrialRecord)
