"""Writes TensorBoard's event files beside the checkpoints, where the user asks for it.

``GEOPRIOR_TENSORBOARD=1`` is the switch. It is no key of the config: a config holds what decides a run's
results, and to watch a run decides nothing.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING

from geoprior import StageEvent, TrainStep, hookimpl
from geoprior.errors import ConfigError, DataError, MachineError

if TYPE_CHECKING:
    from pathlib import Path

    from torch.utils.tensorboard import SummaryWriter

SWITCH = "GEOPRIOR_TENSORBOARD"
_SAID = {"": False, "0": False, "1": True}


@dataclass(frozen=True)
class _Open:
    writer: SummaryWriter
    step: int


_open: dict[Path, _Open] = {}


@hookimpl
def geoprior_before_stage(event: StageEvent) -> None:  # noqa: ARG001 - whatever the stage, it is asked at the door
    """Refuse before the first stage what would fail at the first step logged."""
    _is_wanted()


@hookimpl
def geoprior_train_step(event: TrainStep) -> None:
    """Write the step to the disk; a training that goes on from an earlier step first hides those after it.

    Raises:
        ConfigError: The switch is neither 0 nor 1.
        MachineError: The package tensorboard is not installed.
        DataError: The folder cannot be written.
    """
    if not _is_wanted():
        return
    with _named(event.folder):
        writer = _writer(event)
        for name, value in {**event.metrics, "epoch": event.epoch}.items():
            writer.add_scalar(name, value, event.step)
        # A kill takes what is not on the disk, and the training may go on from after it.
        writer.flush()
        if event.step == event.steps:
            _close(event.folder)


def _is_wanted() -> bool:
    said = os.environ.get(SWITCH, "")
    if said not in _SAID:
        raise ConfigError(
            f"{SWITCH} is {said!r}", "set it to 1 to write TensorBoard's event files, else to 0"
        )
    if _SAID[said] and find_spec("tensorboard") is None:
        raise MachineError(
            f"{SWITCH} is set and the package tensorboard is missing",
            f"pip install 'geoprior[tensorboard]', or unset {SWITCH}",
        )
    return _SAID[said]


def _writer(event: TrainStep) -> SummaryWriter:
    """That of the folder; a new one declares points from this step on, in older files, as taken back."""
    from torch.utils.tensorboard import SummaryWriter

    before = _open.get(event.folder)
    if before is not None and event.step <= before.step:
        _close(event.folder)
        before = None
    writer = before.writer if before else SummaryWriter(str(event.folder), purge_step=event.step)
    _open[event.folder] = _Open(writer, event.step)
    return writer


def _close(folder: Path) -> None:
    _open.pop(folder).writer.close()


@contextmanager
def _named(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise DataError(
            f"{folder}: TensorBoard's event file cannot be written ({error.strerror or error})",
            f"make room and mend the folder's permissions, or unset {SWITCH}",
        ) from error
