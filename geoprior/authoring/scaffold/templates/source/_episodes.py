"""Every so-many-th episode of a folder of shards."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.files import sha256_json
from geoprior.shards.reader import EpisodeStore
from geoprior.sources.shards import ShardSource

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.sources.source import Moments, SourceContext


class SomeEpisodes:
    """See `geoprior.sources.source.Source`.

    Args:
        every: Of so many episodes one is used.
        context: What the run tells a source.
    """

    def __init__(self, every: int, context: SourceContext) -> None:
        self._all = ShardSource(EpisodeStore(context.folder), context.cache_bytes)
        self._chosen = np.arange(0, len(self._all), every)
        self.cameras, self.hands = self._all.cameras, self._all.hands
        self.image_size, self.fps = self._all.image_size, self._all.fps
        self.digest = sha256_json({"episodes": self._all.digest, "every": every})
        self.poses = tuple(self._all.poses[number] for number in self._chosen)
        self.actions = tuple(self._all.actions[number] for number in self._chosen)

    def __len__(self) -> int:
        return len(self._chosen)

    def read(self, numbers: NDArray[np.int64], steps: NDArray[np.int64]) -> Moments:
        """Read moments; a number beyond the first epoch stands for the same episode again."""
        return self._all.read(self._chosen[numbers % len(self)], steps)

    def close(self) -> None:
        """Let go of the files; may be called twice."""
        self._all.close()
