"""Where the members of each sample lie in a shard, and which members a sample must have."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from geoprior.episode import EpisodeHeader, FrameFormat
from geoprior.errors import DataError
from geoprior.shards.archive import REMEDY, Member, read_members

HEADER, POSE, ACTION, TARGETS = "json", "pose.npy", "action.npy", "targets.npy"
PICKLED = frozenset({"pkl", "pickle", "pyd", "pth", "pt"})


@dataclass(frozen=True)
class SampleMembers:
    """The members of one sample.

    Attributes:
        key: Name of the sample.
        members: Suffix (the name after the key and a dot) to the member.
        repeated: Suffixes that occur more than once.
    """

    key: str
    members: dict[str, Member]
    repeated: tuple[str, ...] = ()


@lru_cache(maxsize=64)
def frame_suffixes(camera: str, steps: int) -> tuple[str, ...]:
    """Suffixes of a camera's frames in order of step, for example ``hand.000012.png``."""
    return tuple(f"{camera}.{step:06d}.png" for step in range(steps))


@lru_cache(maxsize=64)
def expected_suffixes(cameras: tuple[str, ...], steps: int, *, targets: bool = False) -> frozenset[str]:
    """Suffixes of the members that a sample of these cameras and steps has, no more and no fewer."""
    frames = [suffix for camera in cameras for suffix in frame_suffixes(camera, steps)]
    return frozenset([HEADER, POSE, ACTION, *([TARGETS] if targets else []), *frames])


def frame_formats(header: EpisodeHeader) -> dict[str, FrameFormat]:
    """Kind and size of each camera's frames."""
    return {camera.name: camera.frame_format for camera in header.cameras}


def index_shard(path: Path) -> list[SampleMembers]:
    """Group a shard's members by sample, in the shard's order.

    Raises:
        DataError: The file is missing, not a tar or cut off; see `read_members`.
    """
    return list(_group(path, read_members(path)))


def member_faults(sample: SampleMembers, header: EpisodeHeader) -> Iterator[str]:
    """Say what keeps the members from being those that the header promises, one sentence a fault."""
    if header.steps > len(sample.members):
        yield f"the header promises {header.steps} steps, there are {len(sample.members)} members in all"
        return
    cameras = tuple(camera.name for camera in header.cameras)
    expected = expected_suffixes(cameras, header.steps, targets=bool(header.targets))
    if missing := sorted(expected - sample.members.keys()):
        yield f"members are missing: {_some(missing)}"
    extra = sorted(sample.members.keys() - expected)
    if pickled := [suffix for suffix in extra if is_pickled(suffix)]:
        yield f"pickled members are refused, for they can run code: {_some(pickled)}"
    if foreign := [suffix for suffix in extra if not is_pickled(suffix)]:
        yield f"members do not belong there: {_some(foreign)}"
    if sample.repeated:
        yield f"members occur more than once: {_some(sample.repeated)}"


def is_pickled(suffix: str) -> bool:
    """Whether common readers would unpickle a member of this suffix."""
    return suffix.lower().removesuffix(".gz").rpartition(".")[2] in PICKLED


def digest_of(hashes: Sequence[str]) -> str:
    """SHA-256 over hexadecimal hashes, one a line, in order."""
    return hashlib.sha256("".join(f"{hash_}\n" for hash_ in hashes).encode()).hexdigest()


def _group(path: Path, members: list[Member]) -> Iterator[SampleMembers]:
    key, found, repeated = "", dict[str, Member](), list[str]()
    for member in members:
        its_key, dot, suffix = member.name.partition(".")
        if not (its_key and dot and suffix):
            raise DataError(f"{path}: member {member.name!r} is not named KEY.SUFFIX", REMEDY)
        if its_key != key:
            if key:
                yield SampleMembers(key, found, tuple(repeated))
            key, found, repeated = its_key, {}, []
        if suffix in found:
            repeated.append(suffix)
        found[suffix] = member
    if key:
        yield SampleMembers(key, found, tuple(repeated))


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(names[:3])
    return shown if len(names) <= 3 else f"{shown} and {len(names) - 3} more"
