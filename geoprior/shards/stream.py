"""Read episodes one after the other through webdataset, for those who stream anyway.

Members are decoded here, never by webdataset's own decoders: those unpickle.
"""

from __future__ import annotations

import tarfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    member_faults,
)
from geoprior.shards.manifest import check_length, read_manifest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.episode import FrameFormat


def iterate(folder: Path) -> Iterator[Episode]:
    """Yield every episode in the manifest's order, read through webdataset's tar reader.

    Raises:
        DataError: The manifest or a shard is missing or cut off, a sample is incomplete or damaged, or
            holds a pickled member.
    """
    # Here, for it imports torch.
    from webdataset.tariterators import group_by_keys, tar_file_expander

    manifest = read_manifest(folder)
    paths = [folder / record.file for record in manifest.shards]
    for path, record in zip(paths, manifest.shards, strict=True):
        check_length(path, record)
    try:
        for sample in group_by_keys(tar_file_expander(_opened(paths))):
            yield _episode(sample)
    except (ValueError, OSError, tarfile.TarError) as error:
        raise DataError(f"{folder}: webdataset cannot read it: {error}", REMEDY) from error


def _opened(paths: Sequence[Path]) -> Iterator[dict[str, Any]]:
    """Sources as webdataset knows them; unlike its own opener this one closes the files."""
    for path in paths:
        with path.open("rb") as stream:
            yield {"url": str(path), "stream": stream}


def _episode(sample: Mapping[str, Any]) -> Episode:
    contents: dict[str, bytes] = {name: data for name, data in sample.items() if not name.startswith("__")}
    where = f"{sample['__url__']}: {sample['__key__']}"
    try:
        header = decode_header(contents.get(HEADER, b""))
    except ValueError as error:
        raise DataError(f"{where}: {HEADER}: {error}", REMEDY) from error
    members = {suffix: Member(suffix, 0, len(data)) for suffix, data in contents.items()}
    for fault in member_faults(SampleMembers(header.key, members), header):
        raise DataError(f"{where}: {fault}", REMEDY)
    return _decoded(where, header, contents)


def _decoded(where: str, header: EpisodeHeader, contents: Mapping[str, bytes]) -> Episode:
    try:
        images = {
            name: np.stack([_frame(contents, suffix, frame) for suffix in frame_suffixes(name, header.steps)])
            for name, frame in frame_formats(header).items()
        }
        targets = decode_npy(contents[TARGETS]) if header.targets else None
        return Episode(header, decode_npy(contents[POSE]), decode_npy(contents[ACTION]), images, targets)
    except ValueError as error:
        raise DataError(f"{where}: {error}", REMEDY) from error


def _frame(contents: Mapping[str, bytes], suffix: str, frame: FrameFormat) -> NDArray[np.uint8]:
    try:
        return decode_png(contents[suffix], frame)
    except ValueError as error:
        raise ValueError(f"{suffix} {error}") from error
