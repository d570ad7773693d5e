"""Files that are whole or not there: temporary name, fsync, rename."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from math import isfinite
from pathlib import Path
from typing import Any

from geoprior.errors import DataError


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Give a temporary path to write to; on success it takes the place of ``path``.

    Raises:
        DataError: The folder cannot be written, or ``path`` is a device, a pipe or a link, which a new file
            would replace. The message names it.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _refuse_special(path)
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise DataError(
            f"{path}: cannot be written ({error.strerror or error})",
            "choose another folder with --out, or make room and mend its permissions",
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _refuse_special(path: Path) -> None:
    with suppress(FileNotFoundError):
        mode = path.lstat().st_mode
        if stat.S_ISLNK(mode):
            remedy = "remove the link, or name the file that it points to"
            raise DataError(f"{path}: a link to {path.readlink()}, which is not replaced", remedy)
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise DataError(f"{path}: a device or a pipe, which is not replaced by a file", "name a file")


def links_of(root: Path, path: Path) -> Iterator[Path]:
    """Links on the way from a folder to a path below it, and below that path.

    Args:
        root: The folder; whether it is a link itself does not matter.
        path: Below it, whether it is there or not.
    """
    ways = [path, *path.parents]
    yield from (way for way in reversed(ways[: ways.index(root)]) if way.is_symlink())
    for folder, folders, files in os.walk(path):
        yield from (found for name in (*folders, *files) if (found := Path(folder, name)).is_symlink())


def is_temporary(path: Path) -> bool:
    """Whether it is what a killed write left behind."""
    return path.name.startswith(".") and ".tmp" in path.name


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def write_json(path: Path, value: Any) -> None:
    """Write JSON atomically: sorted keys, two spaces, a final newline, no NaN."""
    text = json.dumps(value, indent=2, sort_keys=True, allow_nan=False, ensure_ascii=False)
    write_bytes(path, f"{text}\n".encode())


def finite(numbers: Mapping[str, float]) -> dict[str, float | None]:
    """The same for JSON, which knows neither NaN nor infinity: they become null."""
    return {name: number if isfinite(number) else None for name, number in numbers.items()}


def read_json(path: Path) -> Any:
    """Read JSON.

    Raises:
        DataError: The file is missing, cut off or not JSON, which knows neither NaN nor infinity.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file") from error
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(
            f"{path}: not readable as JSON ({error})", "delete the file and run the same command again"
        ) from error


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON")


def sha256_file(path: Path) -> str:
    """The SHA-256 of a file's bytes, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sha256_json(value: Any) -> str:
    """The SHA-256 of a JSON value in its canonical form (sorted keys, no spaces)."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
