"""Write episodes into a shard: a plain tar, one sample an episode, the same bytes every time."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from geoprior.errors import DataError
from geoprior.files import atomic_path
from geoprior.shards.archive import ArchiveWriter
from geoprior.shards.binary_png import encode_binary_png, encode_members
from geoprior.shards.codec import encode_header, encode_levels_png, encode_npy
from geoprior.shards.index import ACTION, HEADER, POSE, TARGETS, frame_suffixes
from geoprior.shards.manifest import ShardRecord, check_name
from geoprior.shards.sample import Sample, check_sample, sample_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.episode import CameraHeader, Episode, FrameFormat


class _Sink:
    """A file that counts and hashes what goes into it."""

    def __init__(self, path: Path) -> None:
        self.file = path.open("wb", buffering=1 << 20)
        self.digest = hashlib.sha256()
        self.bytes = 0

    def write(self, content: bytes | memoryview) -> None:
        self.file.write(content)
        self.digest.update(content)
        self.bytes += len(content)


def write_shard(path: Path, episodes: Iterable[Episode]) -> ShardRecord:
    """Write episodes that are in memory; see `write_samples`."""
    return write_samples(path, map(sample_of, episodes))


def write_samples(path: Path, samples: Iterable[Sample]) -> ShardRecord:
    """Write a shard; it is whole or not there. Holds one sample in memory at a time.

    Args:
        path: ``NAME.tar``.
        samples: In the order wanted; each is checked on the way.

    Returns:
        What the manifest says of it.

    Raises:
        DataError: A sample breaks the contract, two share a key, there is none, or the file cannot be
            written or bear that name; the message names the sample.
    """
    check_name(path)
    keys: dict[str, None] = {}
    with atomic_path(path) as temporary:
        sink = _Sink(temporary)
        with sink.file:
            archive = ArchiveWriter(sink.write)
            for sample in samples:
                if sample.header.key in keys:
                    raise DataError(f"{path}: two episodes have the key {sample.header.key!r}")
                keys[sample.header.key] = None
                _add(path, archive, sample)
                del sample  # before the next one is made
            archive.close()
        if not keys:
            raise DataError(f"{path}: there are no episodes to write")
    return ShardRecord(file=path.name, bytes=sink.bytes, sha256=sink.digest.hexdigest(), samples=list(keys))


def encode_episode(episode: Episode) -> Iterator[tuple[str, bytes]]:
    """The members of an episode's sample as ``(suffix, content)``, in no particular order.

    Raises:
        DataError: The episode breaks the contract; the message names the sample and the field.
    """
    sample = sample_of(episode)
    yield from _small_members(sample).items()
    for camera in episode.header.cameras:
        suffixes = iter(frame_suffixes(camera.name, episode.header.steps))
        for block in sample.frames[camera.name]:
            for frame in block:
                yield next(suffixes), _encode_frame(frame, camera.frame_format)


def _encode_frame(frame: NDArray[np.uint8], frame_format: FrameFormat) -> bytes:
    if frame_format.kind == "binary":
        return encode_binary_png(frame, frame_format.width)
    return encode_levels_png(frame)


def _add(path: Path, archive: ArchiveWriter, sample: Sample) -> None:
    """Add a sample's members in alphabetical order: every camera's frames follow each other in it."""
    check_sample(sample)
    small = _small_members(sample)
    cameras = {frame_suffixes(camera.name, 1)[0]: camera for camera in sample.header.cameras}
    try:
        for suffix in sorted([*small, *cameras]):
            if suffix in small:
                archive.add(f"{sample.header.key}.{suffix}", small[suffix])
            else:
                _add_frames(archive, sample, cameras[suffix])
    except ValueError as error:
        raise DataError(f"{path}: {error}", "use a shorter key or camera name") from error


def _add_frames(archive: ArchiveWriter, sample: Sample, camera: CameraHeader) -> None:
    key, step = sample.header.key, 0
    suffixes = frame_suffixes(camera.name, sample.header.steps)
    for block in sample.frames[camera.name]:
        if camera.frame_format.kind == "binary":
            archive.add_blocks(encode_members(block, camera.width, f"{key}.{suffixes[0]}", step).data)
        else:
            for suffix, frame in zip(suffixes[step:], block, strict=False):
                archive.add(f"{key}.{suffix}", encode_levels_png(frame))
        step += len(block)
    if step != sample.header.steps:
        raise DataError(f"{key}.{camera.name}: {step} frames were made, not {sample.header.steps}")


def _small_members(sample: Sample) -> dict[str, bytes]:
    try:
        header = encode_header(sample.header)
    except ValueError as error:
        raise DataError(f"{sample.header.key}: the header cannot be written as JSON: {error}") from error
    targets = {} if sample.targets is None else {TARGETS: encode_npy(sample.targets)}
    return {HEADER: header, POSE: encode_npy(sample.pose), ACTION: encode_npy(sample.action), **targets}
