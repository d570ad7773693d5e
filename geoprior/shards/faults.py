"""Everything that can be wrong with one sample."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from geoprior.episode import EpisodeHeader, FrameFormat, validate_poses, validate_targets
from geoprior.errors import DataError
from geoprior.shards.archive import Member
from geoprior.shards.codec import decode_header, decode_npy, decode_png
from geoprior.shards.index import (
    ACTION,
    HEADER,
    POSE,
    TARGETS,
    SampleMembers,
    frame_formats,
    frame_suffixes,
    member_faults,
)

Decoded = TypeVar("Decoded")
Read = Callable[[Member], bytes]


def sample_faults(sample: SampleMembers, read: Read) -> Iterator[str]:
    """Say everything that is wrong with a sample, one sentence a fault.

    Args:
        sample: Its members.
        read: Gives the bytes of a member; raises ValueError where they end too soon.
    """
    if HEADER not in sample.members:
        yield f"the header {sample.key}.{HEADER} is missing"
        return
    header, fault = _decode(read, sample.members[HEADER], decode_header)
    if header is None:
        yield fault
        return
    if header.key != sample.key:
        yield f"the header bears another key, {header.key!r}"
    names = [camera.name for camera in header.cameras]
    if names != sorted(set(names)):
        yield f"the header's cameras {names} are not in alphabetical order, or not distinct"
    yield from member_faults(sample, header)
    for suffix in (POSE, ACTION):
        check = partial(validate_poses, header, suffix)
        yield from _array_faults(sample, header, suffix, read, check)
    yield from _array_faults(sample, header, TARGETS, read, partial(validate_targets, header))
    for name, frame in frame_formats(header).items():
        yield from _frame_faults(sample, name, header.steps, frame, read)


def _array_faults(
    sample: SampleMembers,
    header: EpisodeHeader,
    suffix: str,
    read: Read,
    check: Callable[[NDArray[np.float32]], None],
) -> Iterator[str]:
    if suffix not in sample.members:
        return
    array, fault = _decode(read, sample.members[suffix], decode_npy)
    if array is None:
        yield fault
        return
    try:
        check(array)
    except DataError as error:
        yield error.message.removeprefix(f"{header.key}.")


def _frame_faults(
    sample: SampleMembers, camera: str, steps: int, frame: FrameFormat, read: Read
) -> Iterator[str]:
    def decode(data: bytes) -> NDArray[np.uint8]:
        return decode_png(data, frame)

    for suffix in frame_suffixes(camera, min(steps, len(sample.members))):
        member = sample.members.get(suffix)
        fault = _decode(read, member, decode)[1] if member is not None else ""
        if fault:
            yield fault


def _decode(read: Read, member: Member, decode: Callable[[bytes], Decoded]) -> tuple[Decoded | None, str]:
    try:
        return decode(read(member)), ""
    except ValueError as error:
        return None, f"{member.name} {error}"
