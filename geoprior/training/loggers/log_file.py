"""Writes ``log.jsonl`` beside the checkpoints: one line for each logged step."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from geoprior import TrainStep, hookimpl
from geoprior.errors import DataError
from geoprior.files import finite, write_bytes

if TYPE_CHECKING:
    from pathlib import Path

LOG_NAME = "log.jsonl"
_last_step: dict[Path, int] = {}


@hookimpl
def geoprior_train_step(event: TrainStep) -> None:
    """Append the step; a training that goes on from an earlier step first drops the lines after it.

    Raises:
        DataError: The file cannot be written.
    """
    path = event.folder / LOG_NAME
    last = _last_step.get(path)
    if last is None or event.step <= last or not path.exists():
        _drop_from(path, event.step)
    line = {"step": event.step, "epoch": event.epoch, **finite(event.metrics)}
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(f"{json.dumps(line)}\n")
    except OSError as error:
        raise DataError(
            f"{path}: cannot be written ({error.strerror or error})",
            "make room or mend its permissions, and run the same command again",
        ) from error
    _last_step[path] = event.step


def _drop_from(path: Path, step: int) -> None:
    """Keep the whole lines of earlier steps; a line that a kill cut off is dropped with those after it."""
    kept: list[str] = []
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines(keepends=True):
            try:
                earlier = line.endswith("\n") and json.loads(line)["step"] < step
            except (ValueError, KeyError, TypeError):
                break
            if not earlier:
                break
            kept.append(line)
    write_bytes(path, "".join(kept).encode())
