"""Another source's episodes, seen by nobody: what a prior without sight is trained on."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from geoprior.files import sha256_json
from geoprior.sources.source import targets_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from geoprior.sources.source import Moments, Source


class BlindSource:
    """See `geoprior.sources.source.Source`: poses and actions of a source, and black frames.

    The paper's ablation "black image data" without a second data set.

    Args:
        source: Whose episodes they are; closed with this one.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self.cameras, self.hands, self.image_size = source.cameras, source.hands, source.image_size
        self.fps, self.targets = source.fps, targets_of(source)
        self.digest = sha256_json({"black frames of": source.digest})

    @property
    def poses(self) -> Sequence[NDArray[np.float32]]:
        """See `geoprior.sources.source.Source.poses`."""
        return self._source.poses

    @property
    def actions(self) -> Sequence[NDArray[np.float32]]:
        """See `geoprior.sources.source.Source.actions`."""
        return self._source.actions

    def __len__(self) -> int:
        return len(self._source)

    def read(self, numbers: NDArray[np.int64], steps: NDArray[np.int64]) -> Moments:
        """See `geoprior.sources.source.Source.read`."""
        moments = self._source.read(numbers, steps)
        black = {camera: np.zeros_like(frames) for camera, frames in moments.frames.items()}
        return replace(moments, frames=black)

    def close(self) -> None:
        """Close the other source."""
        self._source.close()
