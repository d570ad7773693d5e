"""Check shards to the last byte, and say what they hold."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geoprior.errors import DataError
from geoprior.files import sha256_file
from geoprior.progress import track
from geoprior.shards.faults import sample_faults
from geoprior.shards.index import SampleMembers, index_shard
from geoprior.shards.manifest import MANIFEST, Manifest, ShardRecord, check_length, read_manifest
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.spans import SpanReader


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        file: The manifest or the shard.
        sample: Key of the sample, or empty where the fault is the file's.
        text: What is wrong with it.
    """

    file: Path
    sample: str
    text: str

    def __str__(self) -> str:
        return f"{self.file}: {self.sample}: {self.text}" if self.sample else f"{self.file}: {self.text}"


def verify(path: Path) -> Iterator[Fault]:
    """Yield every fault of a folder of shards, or of one tar; none means that it is whole.

    Checks the manifest, every shard's length and hash, the samples' keys, their members (missing, extra,
    repeated, pickled), headers, poses (finite, quaternions of unit length and continuous, grippers 0 or 1),
    targets (as many as their names, never infinite), that every frame decodes to its camera's size and kind,
    and that the episodes agree on cameras, hands, fps and targets. One tar is checked for itself alone.

    Raises:
        DataError: It is no folder of shards at all; the hint says where there are some.
    """
    faults = _shard_faults(path) if path.is_file() else _folder_faults(path)
    whole = True
    for fault in faults:
        whole = False
        yield fault
    if whole:
        yield from _layout_faults(path)


def info(path: Path) -> dict[str, Any]:
    """Say what a folder of shards, or one tar, holds, as JSON values.

    Returns:
        ``path``, ``shards``, ``episodes``, ``steps``, ``bytes``, ``fps``, ``hands``, ``cameras`` (rows,
        columns, channels of each), ``frames`` (``binary``, ``gray`` or ``rgb`` of each), ``targets``,
        ``motions``, ``sources`` and ``generators`` (episodes of each), and ``digest``.

    Raises:
        DataError: It cannot be opened; see `EpisodeStore`.
    """
    store = EpisodeStore(path)
    headers = [store.header(i) for i in range(len(store))]
    return {
        "path": str(path),
        "shards": len(store.manifest.shards),
        "episodes": len(store),
        "steps": sum(header.steps for header in headers),
        "bytes": store.manifest.bytes,
        "fps": store.fps,
        "hands": list(store.hands),
        "cameras": {name: [*shape[:2], *(shape[2:] or (1,))] for name, shape in store.frame_shapes.items()},
        "frames": {name: frame.kind for name, frame in store.frame_formats.items()},
        "targets": list(store.target_names),
        "motions": dict(sorted(Counter(header.motion for header in headers).items())),
        "sources": dict(sorted(Counter(header.source for header in headers).items())),
        "generators": dict(sorted(Counter(header.generator for header in headers).items())),
        "digest": store.digest,
    }


def _folder_faults(folder: Path) -> Iterator[Fault]:
    if not any(folder.glob("*.tar")) and not (folder / MANIFEST).is_file():
        read_manifest(folder)  # raises: says where data sets lie
    try:
        manifest = read_manifest(folder)
    except DataError as error:
        yield Fault(folder / MANIFEST, "", _without(folder / MANIFEST, error))
        return
    yield from _stray_shards(folder, manifest)
    with track("verify", len(manifest.shards), "shards") as progress:
        for record in manifest.shards:
            yield from _recorded_shard_faults(folder / record.file, record)
            progress.advance()


def _layout_faults(path: Path) -> Iterator[Fault]:
    """What is wrong only with the episodes together; asks the one who must open them."""
    try:
        EpisodeStore(path)
    except DataError as error:
        yield Fault(path, "", _without(path, error))


def _without(path: Path, error: DataError) -> str:
    return error.message.removeprefix(f"{path}: ")


def _stray_shards(folder: Path, manifest: Manifest) -> Iterator[Fault]:
    listed = {record.file for record in manifest.shards}
    for file in sorted(folder.glob("*.tar")):
        if file.name not in listed:
            yield Fault(file, "", "is not listed in the manifest")


def _recorded_shard_faults(path: Path, record: ShardRecord) -> Iterator[Fault]:
    try:
        check_length(path, record)
    except DataError as error:
        yield Fault(path, "", _without(path, error))
    if not path.is_file():
        return
    if (found := sha256_file(path)) != record.sha256:
        yield Fault(path, "", f"its SHA-256 is {found}, the manifest says {record.sha256}")
    yield from _shard_faults(path, record)


def _shard_faults(path: Path, record: ShardRecord | None = None) -> Iterator[Fault]:
    try:
        samples = index_shard(path)
    except DataError as error:
        yield Fault(path, "", _without(path, error))
        return
    if not samples:
        yield Fault(path, "", "holds no samples")
    if record is not None:
        yield from _key_faults(path, samples, record)
    for key, count in Counter(sample.key for sample in samples).items():
        if count > 1:
            yield Fault(path, key, f"its members lie in {count} separate places")
    files = SpanReader([path])
    for sample in samples:
        for text in sample_faults(sample, lambda member: files.read(0, member.offset, member.size)):
            yield Fault(path, sample.key, text)


def _key_faults(path: Path, samples: list[SampleMembers], record: ShardRecord) -> Iterator[Fault]:
    found = [sample.key for sample in samples]
    for key in sorted(set(record.samples) - set(found)):
        yield Fault(path, key, "the manifest lists it, the shard lacks it")
    for key in sorted(set(found) - set(record.samples)):
        yield Fault(path, key, "the shard holds it, the manifest does not list it")
    if found != record.samples and sorted(found) == sorted(record.samples):
        yield Fault(path, "", "its samples are in another order than the manifest says")
