"""The list of a data set's shards: what is there, how long, and which hash."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from geoprior.errors import DataError
from geoprior.files import read_json, sha256_file, write_json
from geoprior.options import Options
from geoprior.shards.archive import MAKE_AGAIN, REMEDY
from geoprior.shards.index import digest_of, index_shard

MANIFEST = "manifest.json"
MANIFEST_VERSION: Literal[1] = 1
FILE_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]*\.tar$"
_REMEDY = f"delete the folder and {MAKE_AGAIN}"


class ShardRecord(Options):
    """One shard."""

    file: str = Field(pattern=FILE_NAME, description="Name in the folder.")
    bytes: int = Field(ge=1, description="Length of the file.")
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$", description="Of the file's bytes.")
    samples: list[str] = Field(min_length=1, description="Keys of the samples, in the shard's order.")


class Manifest(Options):
    """A data set: its shards in order of file name."""

    schema_version: Literal[1] = MANIFEST_VERSION
    shards: list[ShardRecord] = Field(min_length=1, description="In order of file name.")

    @property
    def episodes(self) -> int:
        """Number of episodes in all shards."""
        return sum(len(record.samples) for record in self.shards)

    @property
    def bytes(self) -> int:
        """Length of all shards."""
        return sum(record.bytes for record in self.shards)

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of all samples, in order of shard and place."""
        return tuple(key for record in self.shards for key in record.samples)

    @property
    def digest(self) -> str:
        """The data's fingerprint: SHA-256 over the shards' hashes, in order."""
        return digest_of([record.sha256 for record in self.shards])


def write_manifest(folder: Path, records: Iterable[ShardRecord]) -> Manifest:
    """Write ``manifest.json``; the order of ``records`` does not matter.

    Raises:
        DataError: There is no record, two share a file or a key, or the folder cannot be written.
    """
    shards = sorted(records, key=lambda record: record.file)
    if not shards:
        raise DataError(f"{folder / MANIFEST}: there are no shards to list", "ask for one episode or more")
    manifest = Manifest(shards=shards)
    _refuse_duplicates(folder / MANIFEST, manifest)
    write_json(folder / MANIFEST, manifest.model_dump(mode="json"))
    return manifest


def read_manifest(folder: Path) -> Manifest:
    """Read and check ``manifest.json``.

    Raises:
        DataError: It is missing, damaged, or of a schema that this version does not know.
    """
    path = folder / MANIFEST
    if not path.is_file():
        raise DataError(f"{path}: no such file", _missing_hint(folder))
    content = read_json(path)
    version = content.get("schema_version") if isinstance(content, dict) else None
    if version != MANIFEST_VERSION:
        raise DataError(
            f"{path}: schema_version is {version!r}, this version of geoprior reads {MANIFEST_VERSION}",
            "install the version that wrote it (run.json names it), or " + _REMEDY,
        )
    try:
        manifest = Manifest.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise DataError(f"{path}: {key}: {first['msg']}", _REMEDY) from error
    _refuse_duplicates(path, manifest)
    return manifest


def check_name(path: Path) -> None:
    """Check that a shard's name can stand in a manifest and in any URL.

    Raises:
        DataError: It cannot.
    """
    if not re.fullmatch(FILE_NAME, path.name):
        raise DataError(
            f"{path}: a shard's name has letters, digits, '.', '_' and '-' only, and ends with .tar",
            "rename the file",
        )


def record_of(path: Path) -> ShardRecord:
    """What a manifest would say of a lone shard.

    Raises:
        DataError: It is missing, not a tar, cut off, empty, or its name cannot stand in a manifest.
    """
    check_name(path)
    samples = [sample.key for sample in index_shard(path)]
    if not samples:
        raise DataError(f"{path}: holds no samples", REMEDY)
    return ShardRecord(file=path.name, bytes=path.stat().st_size, sha256=sha256_file(path), samples=samples)


def check_length(path: Path, record: ShardRecord) -> None:
    """Compare a shard's length with its record.

    Raises:
        DataError: The file is missing, shorter or longer.
    """
    found = path.stat().st_size if path.is_file() else None
    if found is None:
        raise DataError(f"{path}: no such file, {record.bytes} bytes are expected", REMEDY)
    if found != record.bytes:
        fault = "cut off" if found < record.bytes else "too long"
        raise DataError(f"{path}: {fault}: {found} bytes, {record.bytes} are expected", REMEDY)


def _refuse_duplicates(path: Path, manifest: Manifest) -> None:
    for what, names in (("file", [record.file for record in manifest.shards]), ("sample", manifest.keys)):
        name, count = Counter(names).most_common(1)[0]
        if count > 1:
            shards = [record.file for record in manifest.shards if name in (record.file, *record.samples)]
            raise DataError(f"{path}: {what} {name!r} is listed {count} times ({', '.join(shards)})", _REMEDY)


def _missing_hint(folder: Path) -> str:
    if not folder.is_dir():
        return "check the path; `geoprior generate` makes such folders"
    below = sorted(str(path.parent) for path in folder.glob(f"*/{MANIFEST}"))
    below += sorted(str(path.parent) for path in folder.glob(f"*/*/{MANIFEST}"))
    if below:
        return f"data sets lie in {', '.join(below[:4])}"
    return f"without it the shards may be half a data set: {MAKE_AGAIN}, it goes on where it was"
