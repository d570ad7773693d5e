"""Episodes on disk. Registering imports neither OpenCV nor the reader: the factory does."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from geoprior import SourceSpec, hookimpl
from geoprior.options import Options
from geoprior.sources.source import Moments, SourceContext

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.shards.reader import EpisodeStore


class ShardsConfig(Options):
    """No options."""


class ShardSource:
    """See `geoprior.sources.source.Source`: every epoch has the store's episodes.

    Poses and actions are in memory; frames stay on disk until they are needed, and the first ones read are
    kept as far as the memory goes.

    Args:
        store: Where the episodes are.
        cache_bytes: Memory for decoded frames; what does not fit is read again.

    Raises:
        DataError: A pose or an action is damaged, or the cameras differ in size.
    """

    def __init__(self, store: EpisodeStore, cache_bytes: int = 0) -> None:
        self.cameras, self.hands, self.image_size = store.cameras, store.hands, store.image_size
        self.fps, self.digest, self.targets = store.fps, store.digest, store.target_names
        episodes = range(len(store))
        self.poses = tuple(store.pose(i) for i in episodes)
        self.actions = tuple(store.action(i) for i in episodes)
        self._targets = tuple(store.targets(i) for i in episodes) if self.targets else ()
        self._store, self._room = store, cache_bytes
        self._kept: dict[tuple[int, str, int], NDArray[np.uint8]] = {}

    def __len__(self) -> int:
        return len(self.poses)

    def read(self, numbers: NDArray[np.int64], steps: NDArray[np.int64]) -> Moments:
        """See `geoprior.sources.source.Source.read`.

        Raises:
            DataError: A frame is damaged; the message names the file and the member.
        """
        episodes = (numbers % len(self)).tolist()
        moments = list(zip(episodes, steps[:, 0].tolist(), strict=True))
        return Moments(
            pose=np.stack([self.poses[episode][time] for episode, time in moments]),
            action=np.stack([self.actions[i][times] for i, times in zip(episodes, steps, strict=True)]),
            frames={
                camera: np.concatenate([self._frame(episode, camera, time) for episode, time in moments])
                for camera in self.cameras
            },
            targets=np.stack([self._targets[i][time] for i, time in moments]) if self.targets else None,
        )

    def close(self) -> None:
        """Nothing to do: the files are closed with the store."""

    def _frame(self, episode: int, camera: str, time: int) -> NDArray[np.uint8]:
        key = (episode, camera, time)
        if key in self._kept:
            return self._kept[key]
        frame = self._store.frames(episode, camera, [time])
        if frame.nbytes <= self._room:
            self._room -= frame.nbytes
            self._kept[key] = frame
        return frame


def _build(_: ShardsConfig, context: SourceContext) -> ShardSource:
    from geoprior.shards.reader import EpisodeStore

    return ShardSource(EpisodeStore(context.folder), context.cache_bytes)


@hookimpl
def geoprior_sources() -> Iterable[SourceSpec]:
    """One source."""
    yield SourceSpec(
        name="shards",
        summary="the episodes that the generate stage wrote, the same in every epoch",
        config=ShardsConfig,
        factory=_build,
    )
