"""A run on disk: its folder, who may work in it, and what each stage has left there."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from geoprior.config import RunConfig, to_yaml
from geoprior.config_tree import differences
from geoprior.errors import ConfigError, DataError
from geoprior.files import is_temporary, links_of, read_json, sha256_json, write_bytes, write_json
from geoprior.stages import Stage

CONFIG_FILE = "config.yaml"
RUN_FILE = "run.json"
LOCK_FILE = ".lock"
RECORDS = "stages"


class Output(TypedDict):
    """A file that a stage wrote."""

    bytes: Annotated[int, Field(ge=0)]
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


@dataclass(frozen=True)
class Record:
    """What ``stages/NAME.json`` says. Anybody may have written it.

    Attributes:
        stage: Name.
        status: ``begun`` or ``done``.
        fingerprint: Of the config and the inputs that the outputs belong to.
        config: The part of the config that went into the fingerprint.
        inputs: Digest of every stage read, and of what was read from outside of the run folder.
        outputs: SHA-256 and bytes of every file written; empty until done.
        result: Small facts that the stage returned.
        seconds: Wall time of the attempt that ended it.
        made_by: Versions, plug-ins and machine of that attempt.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True)

    stage: str
    status: Literal["begun", "done"]
    fingerprint: str
    config: Mapping[str, Any]
    inputs: Mapping[str, str]
    outputs: Mapping[str, Output]
    result: Mapping[str, Any]
    seconds: float
    made_by: Mapping[str, Any] = field(default_factory=dict)

    def passed_on(self, stage: Stage) -> dict[str, Output]:
        """Those outputs that later stages read."""
        return {
            name: output
            for name, output in self.outputs.items()
            if any(fnmatch(Path(name).name, pattern) for pattern in stage.passes_on)
        }

    def digest(self, stage: Stage) -> str:
        """One hash of what the stage passes on: the input of the stages after it."""
        return sha256_json({name: output["sha256"] for name, output in self.passed_on(stage).items()})


_RECORD = TypeAdapter(Record)


def _where(error: ValidationError | DataError) -> str:
    if isinstance(error, DataError):
        return f" ({error.message})"
    first = error.errors(include_url=False)[0]
    return f": key {'.'.join(map(str, first['loc'])) or '(all of it)'}: {first['msg'].lower()}"


def _require_names_below(path: Path, record: Record) -> None:
    """A record that comes from elsewhere must not lead out of its folder, to be read or to be removed."""
    for name in record.outputs:
        parts = PurePosixPath(name).parts
        if not parts or parts[0] == "/" or ".." in parts or "\0" in name:
            raise DataError(
                f"{path}: key outputs: names {name!r}, which does not lie in the run folder",
                "geoprior writes no such record: do not trust this folder",
            )


class RunFolder:
    """One run on disk. Open it with `open_run`."""

    def __init__(self, path: Path, config: RunConfig) -> None:
        self.path = path
        self.config = config

    def record(self, stage: str) -> Record | None:
        """The stage's record, or None when it has never begun here.

        Raises:
            DataError: The record is damaged, or it names a file that does not lie in a run folder.
        """
        path = self.path / RECORDS / f"{stage}.json"
        if not path.is_file():
            return None
        try:
            record = _RECORD.validate_json(json.dumps(read_json(path)))
        except (ValidationError, DataError) as error:
            raise DataError(
                f"{path}: not a stage record{_where(error)}",
                f"what lies there may be of another config: delete it and what {stage} wrote, run it again",
            ) from error
        _require_names_below(path, record)
        return record

    def write_record(self, record: Record) -> None:
        """Write the stage's record."""
        write_json(self.path / RECORDS / f"{record.stage}.json", vars(record))

    def lost(self, record: Record, stage: Stage) -> list[str]:
        """Files that a done stage passes on and that are not there with their size."""
        return [
            name
            for name, output in record.passed_on(stage).items()
            if not (self.path / name).is_file() or (self.path / name).stat().st_size != output["bytes"]
        ]


@contextmanager
def open_run(path: Path, config: RunConfig, stages: Sequence[Stage], *, replace: bool) -> Iterator[RunFolder]:
    """Make or reopen a run folder and hold it for this process alone.

    Args:
        path: The folder.
        config: Resolved.
        stages: Those that may have left something here.
        replace: Whether stages whose config has changed may be run again, in place of their outputs.

    Raises:
        DataError: Not writable, in use by another process, or a folder with other things in it.
        ConfigError: It holds results of another config and ``replace`` is false.
    """
    _refuse_foreign(path)
    with _locked(path):
        folder = RunFolder(path, config)
        changed = [stage for stage in stages if _config_changed(folder, stage)]
        if changed and not replace:
            raise ConfigError(
                f"{path}: holds results of another config: {_changes(folder, changed)}",
                "choose another --out, or give --replace to run the changed stages again in their place",
            )
        for stage in changed:
            clear(folder, stage)
        write_bytes(path / CONFIG_FILE, to_yaml(config).encode())
        yield folder


def saved_config(path: Path) -> Path | None:
    """The resolved config that an earlier run left in this folder, if any."""
    file = path / CONFIG_FILE
    return file if file.is_file() else None


def refuse_links(folder: RunFolder, stage: Stage) -> None:
    """Refuse to write and to remove where a link would lead out of the run folder.

    Raises:
        DataError: One of the stage's outputs is a link, lies behind one, or holds one.
    """
    for output in stage.outputs:
        for link in links_of(folder.path, folder.path / output):
            raise DataError(
                f"{link}: a link to {link.readlink()}; a stage writes and removes in its run folder alone",
                "remove the link, or give as --out a folder on that disk",
            )


def clear(folder: RunFolder, stage: Stage) -> None:
    """Remove a stage's outputs and its record.

    A folder gets another name before it is emptied, and the record goes when nothing stands in an output's
    place: whoever is killed meanwhile leaves no old file among new ones, and none that counts as new.

    Raises:
        DataError: See `refuse_links`; nothing is removed then.
    """
    refuse_links(folder, stage)
    outputs = [folder.path / output for output in stage.outputs]
    sweep(folder, stage)
    for path in outputs:
        if path.is_dir():
            path.rename(_removed(path))
        else:
            path.unlink(missing_ok=True)
    (folder.path / RECORDS / f"{stage.name}.json").unlink(missing_ok=True)
    sweep(folder, stage)


def sweep(folder: RunFolder, stage: Stage) -> None:
    """Remove what killed processes left: folders that were to be removed, and halves of files."""
    for path in (folder.path / output for output in stage.outputs):
        if _removed(path).is_dir():
            shutil.rmtree(_removed(path))
        for leftover in [*path.parent.glob(f".{path.name}.*"), *path.rglob(".*")]:
            if is_temporary(leftover) and leftover.is_file():
                leftover.unlink(missing_ok=True)


def drop(folder: RunFolder, stage: Stage, lost: Sequence[str]) -> None:
    """Remove damaged files, so that the stage makes them again.

    A file that is an output by itself stays: its stage goes on with the lines that are whole. Only what lies
    in the stage's own outputs is removed.
    """
    for name in lost:
        if any(PurePosixPath(name).is_relative_to(output) and name != output for output in stage.outputs):
            (folder.path / name).unlink(missing_ok=True)


def _removed(path: Path) -> Path:
    return path.with_name(f".{path.name}.removed")


def _config_changed(folder: RunFolder, stage: Stage) -> bool:
    record = folder.record(stage.name)
    return record is not None and record.config != stage.config(folder.config)


def _changes(folder: RunFolder, changed: Sequence[Stage]) -> str:
    lines: list[str] = []
    for stage in changed:
        record = folder.record(stage.name)
        assert record is not None
        for line in differences(record.config, stage.config(folder.config)):
            if line not in lines:
                lines.append(line)
    return "; ".join(lines[:5]) + (f" and {len(lines) - 5} more" if len(lines) > 5 else "")


def _refuse_foreign(path: Path) -> None:
    if path.exists() and not path.is_dir():
        raise DataError(f"{path}: is a file, not a folder", "choose another --out")
    if (path / RECORDS).is_symlink():
        raise DataError(f"{path / RECORDS}: a link; records lie in the run folder", "remove the link")
    ours = (path / CONFIG_FILE).is_file() or (path / LOCK_FILE).is_file()
    if path.is_dir() and any(path.iterdir()) and not ours:
        raise DataError(f"{path}: is not empty and not a run folder of geoprior", "choose another --out")


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    try:
        path.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise DataError(
            f"{path}: cannot be written ({error.strerror})", "choose another --out or mend its permissions"
        ) from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise DataError(
                f"{path}: another geoprior is at work in this folder", "wait for it, or choose another --out"
            ) from error
        yield
    finally:
        os.close(descriptor)
