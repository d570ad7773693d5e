"""Read episodes at random from shards, without unpacking and without webdataset."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from geoprior.episode import Episode, EpisodeHeader
from geoprior.errors import DataError
from geoprior.shards.archive import REMEDY, Member
from geoprior.shards.codec import decode_header, decode_npy, decode_png
from geoprior.shards.index import (
    ACTION,
    HEADER,
    POSE,
    TARGETS,
    SampleMembers,
    frame_formats,
    frame_suffixes,
    index_shard,
    member_faults,
)
from geoprior.shards.manifest import Manifest, check_length, read_manifest, record_of
from geoprior.shards.spans import SpanReader

if TYPE_CHECKING:
    from numpy.typing import NDArray

Decoded = TypeVar("Decoded")


@dataclass(frozen=True)
class _Entry:
    """Where one episode lies: number of its shard, its arrays, and per camera (N, 2) offset and size."""

    shard: int
    key: str
    header: Member
    pose: Member
    action: Member
    targets: Member | None
    frames: dict[str, NDArray[np.int64]]


class EpisodeStore:
    """The episodes of a folder of shards, by number, in the manifest's order.

    Opening checks every file's length against the manifest, finds the members and reads the headers. A
    store may be used by several threads, inherited by a fork, or pickled to a spawned process, which does
    not search again.

    Args:
        path: A folder with a manifest, or one tar.

    Attributes:
        path: As given.
        manifest: Of the folder, or made up for one tar.
        cameras: Names of the cameras, in alphabetical order.
        frame_formats: Kind and size of each camera's frames.
        hands: Names of the hands, in pose order.
        fps: Time steps a second.
        target_names: What the numbers of `targets` are; none where the episodes have none.

    Raises:
        DataError: The manifest or a shard is missing, cut off or damaged, or two episodes disagree on
            cameras, their sizes, hands or fps.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.manifest, folder = _manifest(path)
        files = [folder / record.file for record in self.manifest.shards]
        for file, record in zip(files, self.manifest.shards, strict=True):
            check_length(file, record)
        self._files = SpanReader(files)
        self._entries: list[_Entry] = []
        first = self._index_all()
        self.frame_formats = frame_formats(first)
        self.cameras = tuple(self.frame_formats)
        self.hands = tuple(first.hands)
        self.fps = first.fps
        self.target_names = tuple(first.targets)

    def __len__(self) -> int:
        return len(self._entries)

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the episodes."""
        return tuple(entry.key for entry in self._entries)

    @property
    def frame_shapes(self) -> dict[str, tuple[int, ...]]:
        """Per camera (H, W) if binary or gray, (H, W, 3) if RGB."""
        return {name: frame.shape for name, frame in self.frame_formats.items()}

    @property
    def image_size(self) -> tuple[int, int]:
        """(height, width) of every camera, in pixels.

        Raises:
            DataError: The cameras differ in size.
        """
        sizes = {name: (shape[0], shape[1]) for name, shape in self.frame_shapes.items()}
        if len(set(sizes.values())) > 1:
            raise DataError(f"{self.path}: the cameras differ in size: {sizes}")
        return next(iter(sizes.values()))

    @property
    def digest(self) -> str:
        """The data's fingerprint: SHA-256 over the shards' hashes."""
        return self.manifest.digest

    def position(self, episode: str | int) -> int:
        """The number of the episode that a key, or a number as such or in digits, names.

        Raises:
            DataError: There is none; the hint names the nearest.
        """
        keys, name = self.keys, str(episode)
        if name in keys:
            return keys.index(name)
        if name.isdecimal() and int(name) < len(keys):
            return int(name)
        near = difflib.get_close_matches(name, keys, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise DataError(
            f"{self.path}: no episode {episode!r}", f"{hint}it holds {len(keys)}: {keys[0]} to {keys[-1]}"
        )

    def header(self, i: int) -> EpisodeHeader:
        """The header of episode ``i``."""
        entry = self._entries[i]
        return self._read(entry.shard, entry.header, decode_header)

    def pose(self, i: int) -> NDArray[np.float32]:
        """(N, 8 x hands) float32 poses of episode ``i``; see `Episode`."""
        entry = self._entries[i]
        return self._read(entry.shard, entry.pose, decode_npy)

    def action(self, i: int) -> NDArray[np.float32]:
        """(N, 8 x hands) float32 commands of episode ``i``; see `Episode`."""
        entry = self._entries[i]
        return self._read(entry.shard, entry.action, decode_npy)

    def targets(self, i: int) -> NDArray[np.float32] | None:
        """(N, T) float32 targets of episode ``i``, or None where the episodes have none; see `Episode`."""
        entry = self._entries[i]
        return None if entry.targets is None else self._read(entry.shard, entry.targets, decode_npy)

    def frames(self, i: int, camera: str, steps: Sequence[int]) -> NDArray[np.uint8]:
        """Frames of one camera.

        Args:
            i: Number of the episode.
            camera: Name of the view.
            steps: S time steps in [0, N), in any order, repeated or not.

        Returns:
            (S, H, W) uint8, of a binary camera 0 or 255, or (S, H, W, 3) RGB.

        Raises:
            IndexError: A step is outside the episode.
            DataError: There is no such camera, or a frame is damaged.
        """
        if camera not in self.frame_formats:
            raise DataError(f"{self.path}: no camera {camera!r}", f"choices: {', '.join(self.cameras)}")
        entry, frame = self._entries[i], self.frame_formats[camera]
        spans = entry.frames[camera]
        suffixes = frame_suffixes(camera, len(spans))
        frames = np.empty((len(steps), *frame.shape), np.uint8)
        for row, step in enumerate(steps):
            if not 0 <= step < len(spans):
                raise IndexError(f"{entry.key}: step {step} is not in 0 to {len(spans) - 1}")
            offset, size = spans[step].tolist()
            member = Member(f"{entry.key}.{suffixes[step]}", offset, size)
            frames[row] = self._read(entry.shard, member, lambda data: decode_png(data, frame))
        return frames

    def episode(self, i: int) -> Episode:
        """All of episode ``i``."""
        header = self.header(i)
        images = {name: self.frames(i, name, range(header.steps)) for name in self.cameras}
        return Episode(header, self.pose(i), self.action(i), images, self.targets(i))

    def _index_all(self) -> EpisodeHeader:
        """Fill ``_entries``; returns the first header, with which all others agree."""
        first: EpisodeHeader | None = None
        for shard, record in enumerate(self.manifest.shards):
            samples = index_shard(self._files.paths[shard])
            if [sample.key for sample in samples] != record.samples:
                raise DataError(
                    f"{self._files.paths[shard]}: holds other samples than the manifest says", REMEDY
                )
            for sample in samples:
                header = self._sample_header(shard, sample)
                first = first or header
                _require_agreement(self.path, first, header)
                self._entries.append(_entry(shard, sample, header))
        assert first is not None
        return first

    def _sample_header(self, shard: int, sample: SampleMembers) -> EpisodeHeader:
        where = f"{self._files.paths[shard]}: {sample.key}"
        if HEADER not in sample.members:
            raise DataError(f"{where}: the header {sample.key}.{HEADER} is missing", REMEDY)
        header = self._read(shard, sample.members[HEADER], decode_header)
        if header.key != sample.key:
            raise DataError(f"{where}: the header bears another key, {header.key!r}", REMEDY)
        for fault in member_faults(sample, header):
            raise DataError(f"{where}: {fault}", REMEDY)
        return header

    def _read(self, shard: int, member: Member, decode: Callable[[bytes], Decoded]) -> Decoded:
        try:
            return decode(self._files.read(shard, member.offset, member.size))
        except ValueError as error:
            raise DataError(f"{self._files.paths[shard]}: {member.name} {error}", REMEDY) from error


def _manifest(path: Path) -> tuple[Manifest, Path]:
    if path.is_file():
        return Manifest(shards=[record_of(path)]), path.parent
    return read_manifest(path), path


def _entry(shard: int, sample: SampleMembers, header: EpisodeHeader) -> _Entry:
    members = sample.members
    frames: dict[str, NDArray[np.int64]] = {}
    for camera in header.cameras:
        found = [members[suffix] for suffix in frame_suffixes(camera.name, header.steps)]
        frames[camera.name] = np.array([(member.offset, member.size) for member in found], np.int64)
    arrays = members[POSE], members[ACTION], members.get(TARGETS)
    return _Entry(shard, sample.key, members[HEADER], *arrays, frames)


def _layout(header: EpisodeHeader) -> dict[str, Any]:
    return {
        "cameras": {name: str(frame) for name, frame in frame_formats(header).items()},
        "hands": header.hands,
        "fps": header.fps,
        "targets": header.targets,
    }


def _require_agreement(path: Path, first: EpisodeHeader, other: EpisodeHeader) -> None:
    ours, theirs = _layout(first), _layout(other)
    for name, value in ours.items():
        if theirs[name] != value:
            raise DataError(
                f"{path}: the episodes {first.key} and {other.key} disagree on {name}: "
                f"{value} and {theirs[name]}",
                "keep episodes of different layouts in different folders",
            )
