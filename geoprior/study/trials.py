"""The trials of a study: the lines of ``rollouts.jsonl``, each of them there and none twice."""

from __future__ import annotations

from pathlib import Path

from geoprior.errors import DataError
from geoprior.sim.records import TrialRecord, parse_record


def read_rollouts(path: Path) -> tuple[TrialRecord, ...]:
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
    trials: list[TrialRecord] = []
    line_of: dict[tuple[object, ...], int] = {}
    for number, line in enumerate(lines, start=1):
        trial = parse_record(line, f"{path}, line {number}", hint)
        first = line_of.setdefault((trial.scene, trial.key), number)
        if first != number:
            raise DataError(f"{path}, line {number}: the same trial as on line {first}", hint)
        trials.append(trial)
    return tuple(trials)
