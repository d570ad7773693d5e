"""An episode on its way into a shard: small arrays, and frames in blocks, packed where they are binary."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from geoprior.episode import Episode, EpisodeHeader, validate_poses, validate_targets
from geoprior.errors import DataError
from geoprior.shards.binary_png import pack_white

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.episode import FrameFormat

_BLOCK_BYTES = 1 << 21


@dataclass(frozen=True)
class Sample:
    """What is written of one episode, once: its frames may be made while they are written.

    Attributes:
        header: See `EpisodeHeader`.
        pose: (N, 8 x hands) float32; see `Episode`.
        action: (N, 8 x hands) float32; see `Episode`.
        frames: Per camera its frames in order, some at a time: (n, H, ceil(W / 8)) uint8 of a binary camera,
            as `numpy.packbits` gives them, (n, H, W) uint8 gray or (n, H, W, 3) uint8 RGB.
        targets: (N, T) float32 or None; see `Episode`.
    """

    header: EpisodeHeader
    pose: NDArray[np.float32]
    action: NDArray[np.float32]
    frames: Mapping[str, Iterable[NDArray[np.uint8]]]
    targets: NDArray[np.float32] | None = None


def sample_of(episode: Episode) -> Sample:
    """An episode in memory as a sample.

    Raises:
        DataError: It breaks the contract; the message names the sample and the field. A binary frame with
            another value than 0 and 255 is found when the frames are iterated over.
    """
    episode.validate()
    key = episode.header.key
    frames = {
        camera.name: _blocks_of(f"{key}.{camera.name}", episode.images[camera.name], camera.frame_format)
        for camera in episode.header.cameras
    }
    return Sample(episode.header, episode.pose, episode.action, frames, episode.targets)


def check_sample(sample: Sample) -> None:
    """Check everything but the frames against the header.

    Raises:
        DataError: Naming the sample and the field.
    """
    header = sample.header
    validate_poses(header, "pose", sample.pose)
    validate_poses(header, "action", sample.action)
    validate_targets(header, sample.targets)
    names = [camera.name for camera in header.cameras]
    if names != sorted(set(names)) or set(names) != set(sample.frames):
        raise DataError(f"{header.key}: cameras {names} do not match frames of {sorted(sample.frames)}")


def block_slices(steps: int, frame_bytes: int) -> Iterator[slice]:
    """Cut the steps of an episode so that a block of frames stays near the processor."""
    size = max(1, _BLOCK_BYTES // frame_bytes)
    for first in range(0, steps, size):
        yield slice(first, min(first + size, steps))


def _blocks_of(where: str, images: NDArray[np.uint8], frame: FrameFormat) -> Iterator[NDArray[np.uint8]]:
    for steps in block_slices(len(images), images[0].nbytes):
        yield _packed(where, images[steps], steps.start) if frame.kind == "binary" else images[steps]


def _packed(where: str, frames: NDArray[np.uint8], first: int) -> NDArray[np.uint8]:
    try:
        return pack_white(frames)
    except ValueError as error:
        step = int(np.argmax(((frames != 0) & (frames != 255)).any(axis=(1, 2))))
        raise DataError(f"{where}: step {first + step} {error}") from error
