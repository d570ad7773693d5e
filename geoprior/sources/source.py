"""What training reads from, and what a source is told of the run. Light: no torch, no OpenCV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from geoprior.geometry.camera import CamerasConfig
    from geoprior.synthesis.config import GenerateConfig


@dataclass(frozen=True)
class SourceContext:
    """What a run tells a source.

    Attributes:
        folder: The shards that the generate stage wrote.
        generate: What that stage was told to make.
        cameras: Lenses and size of the frames.
        seed: Root seed of the run.
        cache_bytes: Memory in which a source may keep what it has read or made; never changes a result.
    """

    folder: Path
    generate: GenerateConfig
    cameras: CamerasConfig
    seed: int
    cache_bytes: int = 0


@dataclass(frozen=True)
class Moments:
    """B moments of episodes: what is seen and done then, as recorded.

    Attributes:
        pose: (B, pose_size) float32, where the hands are.
        action: (B, C, pose_size) float32, what is commanded at C time steps of the moment's episode.
        frames: Per camera (B, H, W) uint8, binary (0 or 255) or gray, or (B, H, W, 3) RGB.
        targets: (B, T) float32 of what the source's `targets` names, NaN where there is none; None without.
    """

    pose: NDArray[np.float32]
    action: NDArray[np.float32]
    frames: Mapping[str, NDArray[np.uint8]]
    targets: NDArray[np.float32] | None = None


class Source(Protocol):
    """Episodes for one training, by number.

    An epoch has ``len(source)`` slots and takes one moment of the episode in each. Numbers count over the
    whole training: number ``k * len(source) + s`` is what stands in slot ``s`` in epoch ``k``. A source of so
    many recorded episodes gives the same ones in every epoch; one that makes episodes may give others. What a
    number stands for never depends on what was read before.

    One attribute more may be there: ``targets``, a tuple of T names, says what the numbers of
    `Moments.targets` are, for policies that learn them on the side; see `geoprior.synthesis.targets`. Ask for
    it with `targets_of`.
    """

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names in alphabetical order."""
        ...

    @property
    def hands(self) -> tuple[str, ...]:
        """Names, in the order of their parts of a pose."""
        ...

    @property
    def image_size(self) -> tuple[int, int]:
        """(height, width) of every camera, in pixels."""
        ...

    @property
    def fps(self) -> float:
        """Time steps a second."""
        ...

    @property
    def digest(self) -> str:
        """Fingerprint of all episodes that the source can give: SHA-256, in hexadecimal digits."""
        ...

    @property
    def poses(self) -> Sequence[NDArray[np.float32]]:
        """Of the episodes of the first epoch, by slot: (N, pose_size); a slot's N never changes."""
        ...

    @property
    def actions(self) -> Sequence[NDArray[np.float32]]:
        """Of the same episodes: (N, pose_size)."""
        ...

    def __len__(self) -> int:
        """Slots of an epoch."""
        ...

    def read(self, numbers: NDArray[np.int64], steps: NDArray[np.int64]) -> Moments:
        """Read moments.

        Args:
            numbers: (B,) of the episodes.
            steps: (B, C) time steps of each episode, C at least 1. Pose and frames are those of the first
                one, actions those of all.

        Raises:
            GeopriorError: An episode cannot be read or made.
        """
        ...

    def close(self) -> None:
        """Let go of files and processes; nothing is read afterwards. May be called twice."""
        ...


def targets_of(source: Source) -> tuple[str, ...]:
    """Names of the source's targets; none of a source that knows of none."""
    names: tuple[str, ...] = getattr(source, "targets", ())
    return names
