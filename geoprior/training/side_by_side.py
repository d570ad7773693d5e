"""Trainings that do not depend on each other, each in a process of an executor: one progress bar for all."""

from __future__ import annotations

import json
import os
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from geoprior.progress import track
from geoprior.training.loggers.log_file import LOG_NAME

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from geoprior.hooks.types import Executor
    from geoprior.progress import Track

Item = TypeVar("Item")
Result = TypeVar("Result")
_SECONDS_BETWEEN_LOOKS = 0.5
_TAIL = 65_536
"""Bytes that surely hold the last whole line of a log."""


def run_side_by_side(
    label: str,
    function: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    folders: Sequence[Path],
    epochs: int,
    executor: Executor,
) -> list[Result]:
    """Run some trainings in an executor's processes.

    Args:
        label: What is being done.
        function: Trains, without progress of its own; importable.
        items: What it is given; can be pickled.
        folders: Where each one writes its ``log.jsonl``, by which its progress is known.
        epochs: Of each.
        executor: Runs them.

    Returns:
        The function's results, in the order of the items.

    Raises:
        GeopriorError: What a training raised, or a process died.
    """
    results: dict[int, Result] = {}
    with _shown(label, folders, epochs):
        for position, result in executor.run(function, items):
            results[position] = result
    return [results[position] for position in range(len(items))]


@contextmanager
def _shown(label: str, folders: Sequence[Path], epochs: int) -> Iterator[None]:
    over = threading.Event()
    with track(label, epochs * len(folders), "epochs", done=sum(_epochs(folders, epochs))) as shown:
        watch = threading.Thread(target=_watch, args=(shown, folders, epochs, over), daemon=True)
        watch.start()
        try:
            yield
        finally:
            over.set()
            watch.join()
            _update(shown, folders, epochs)


def _watch(shown: Track, folders: Sequence[Path], epochs: int, over: threading.Event) -> None:
    while not over.wait(_SECONDS_BETWEEN_LOOKS):
        _update(shown, folders, epochs)


def _update(shown: Track, folders: Sequence[Path], epochs: int) -> None:
    done = _epochs(folders, epochs)
    trainings = f"{sum(each == epochs for each in done)}/{len(done)}"
    shown.advance(max(0, sum(done) - shown.done), trainings=trainings)


def _epochs(folders: Sequence[Path], epochs: int) -> list[int]:
    return [min(epochs, int(logged_epoch(folder / LOG_NAME))) for folder in folders]


def logged_epoch(path: Path) -> float:
    """How far a training is by its ``log.jsonl``, which it may be writing; 0 where nobody can tell."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - _TAIL))
            lines = file.read().split(b"\n")
    except OSError:
        return 0.0
    for line in reversed(lines[:-1]):
        try:
            return float(json.loads(line)["epoch"])
        except (ValueError, KeyError, TypeError):
            continue
    return 0.0
