"""Write episodes into a shard: a plain tar, one sample an episode, the same bytes every time."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from geoprior.errors import DataError
from geoprior.files import atomic_path
from geoprior.shards.archive import ArchiveWriter
from geoprior.shards.codec import encode_header, encode_npy, encode_png
from geoprior.shards.index import ACTION, HEADER, POSE, frame_suffixes
from geoprior.shards.manifest import ShardRecord, check_name

if TYPE_CHECKING:
    from geoprior.shards.episode import Episode


class _Sink:
    """A file that counts and hashes what goes into it."""

    def __init__(self, path: Path) -> None:
        self.file = path.open("wb", buffering=1 << 20)
        self.digest = hashlib.sha256()
        self.bytes = 0

    def write(self, content: bytes) -> None:
        self.file.write(content)
        self.digest.update(content)
        self.bytes += len(content)


def write_shard(path: Path, episodes: Iterable[Episode]) -> ShardRecord:
    """Write a shard; it is whole or not there. Holds one episode in memory at a time.

    Args:
        path: ``NAME.tar``.
        episodes: In the order wanted; each is checked on the way.

    Returns:
        What the manifest says of it.

    Raises:
        DataError: An episode breaks the contract, two share a key, there is none, or the file cannot be
            written or bear that name; the message names the sample.
    """
    check_name(path)
    keys: dict[str, None] = {}
    with atomic_path(path) as temporary:
        sink = _Sink(temporary)
        with sink.file:
            archive = ArchiveWriter(sink.write)
            for episode in episodes:
                if episode.header.key in keys:
                    raise DataError(f"{path}: two episodes have the key {episode.header.key!r}")
                keys[episode.header.key] = None
                _add(path, archive, episode)
                del episode  # before the next one is made
            archive.close()
        if not keys:
            raise DataError(f"{path}: there are no episodes to write")
    return ShardRecord(file=path.name, bytes=sink.bytes, sha256=sink.digest.hexdigest(), samples=list(keys))


def encode_episode(episode: Episode) -> Iterator[tuple[str, bytes]]:
    """The members of a sample as ``(suffix, content)``, in no particular order.

    Raises:
        DataError: The episode breaks the contract; the message names the sample and the field.
    """
    episode.validate()
    key = episode.header.key
    try:
        yield HEADER, encode_header(episode.header)
    except ValueError as error:
        raise DataError(f"{key}: the header cannot be written as JSON: {error}") from error
    yield POSE, encode_npy(episode.pose)
    yield ACTION, encode_npy(episode.action)
    for camera in episode.header.cameras:
        suffixes = frame_suffixes(camera.name, episode.header.steps)
        for step, frame in enumerate(episode.images[camera.name]):
            try:
                yield suffixes[step], encode_png(frame)
            except ValueError as error:
                raise DataError(f"{key}.{camera.name}: step {step} {error}") from error


def _add(path: Path, archive: ArchiveWriter, episode: Episode) -> None:
    key = episode.header.key
    for suffix, content in sorted(encode_episode(episode)):
        try:
            archive.add(f"{key}.{suffix}", content)
        except ValueError as error:
            raise DataError(f"{path}: {error}", "use a shorter key or camera name") from error
