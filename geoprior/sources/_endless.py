"""The source that makes its episodes; see `geoprior.sources.endless`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.files import sha256_json
from geoprior.progress import track
from geoprior.render.frames import unpacked
from geoprior.sources._stager import Stager, StagerConfig
from geoprior.sources._turnover import Turnover
from geoprior.sources._workers import Worker, WorkerHere, WorkerProcess
from geoprior.sources.source import Moments
from geoprior.synthesis.studio import hands_of, recipe
from geoprior.synthesis.targets import target_names

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from geoprior.sources.endless import EndlessConfig
    from geoprior.sources.source import SourceContext

_PORTION = 64
"""Episodes of the first epoch that a worker answers for at a time: a message stays small."""


class EndlessSource:
    """See `geoprior.sources.source.Source`: most epochs bring episodes that no epoch before had.

    Each worker serves slots of its own, so that an episode is staged once, whatever their number. Only the
    moments wanted come back, binary frames packed: half a KiB each at 64 x 64.

    Args:
        config: Of the source.
        context: Of the run; nothing is read from its folder.
        quiet: Say nothing while the first epoch is staged.

    Raises:
        GeopriorError: An episode of the first epoch cannot be staged, or a worker died.
    """

    def __init__(self, config: EndlessConfig, context: SourceContext, *, quiet: bool = False) -> None:
        generate = context.generate
        self._motions = len(generate.motions)
        episodes = config.episodes or generate.episodes
        self._turnover = Turnover(episodes * self._motions, config.keep)
        self.hands = hands_of(generate.motions[0])
        self.image_size = context.cameras.height, context.cameras.width
        self.fps = generate.fps
        self.digest = _digest(context, self._turnover)
        self._workers = _start(config.workers, context, episodes)
        try:
            self.poses, self.actions = self._first_epoch(quiet=quiet)
            self.cameras = self._workers[0].ask(Stager.cameras)()
            self._frames = self._workers[0].ask(Stager.frames)()
            self.targets = target_names(self.hands, self.cameras) if generate.targets else ()
        except BaseException:
            self.close()
            raise

    def __len__(self) -> int:
        return self._turnover.slots

    def read(self, numbers: NDArray[np.int64], steps: NDArray[np.int64]) -> Moments:
        """See `geoprior.sources.source.Source.read`.

        Raises:
            GeopriorError: An episode cannot be staged, or a worker died.
        """
        rows: dict[int, list[int]] = {}
        for row, number in enumerate(numbers.tolist()):
            rows.setdefault(self._worker_of(number), []).append(row)
        asked = [self._ask_moments(worker, numbers[mine], steps[mine]) for worker, mine in rows.items()]
        parts = [wait() for wait in asked]
        order = np.argsort(np.concatenate(list(rows.values())))
        width = self.image_size[1]
        return Moments(
            pose=np.concatenate([part.pose for part in parts])[order],
            action=np.concatenate([part.action for part in parts])[order],
            frames={
                camera: unpacked(
                    self._frames, np.concatenate([part.frames[camera] for part in parts])[order], width
                )
                for camera in self.cameras
            },
            targets=_joined([part.targets for part in parts if part.targets is not None], order),
        )

    def close(self) -> None:
        """End the workers."""
        for worker in self._workers:
            worker.close()

    def _worker_of(self, number: int) -> int:
        """All motions of an index go to the same worker: some take longer than others."""
        return number % len(self) // self._motions % len(self._workers)

    def _ask_moments(
        self, worker: int, numbers: NDArray[np.int64], steps: NDArray[np.int64]
    ) -> Callable[[], Moments]:
        slots = [number % len(self) for number in numbers.tolist()]
        episodes = [self._turnover.episode(number) for number in numbers.tolist()]
        return self._workers[worker].ask(Stager.moments, slots, episodes, steps)

    def _first_epoch(
        self, *, quiet: bool
    ) -> tuple[Sequence[NDArray[np.float32]], Sequence[NDArray[np.float32]]]:
        """Poses and actions by slot; the workers keep what they stage for it."""
        found: dict[int, tuple[NDArray[np.float32], NDArray[np.float32]]] = {}
        asked = [
            (slots, self._workers[worker].ask(Stager.trajectories, slots, slots))
            for worker, slots in self._portions()
        ]
        with track("first epoch", len(self), "episodes", quiet=quiet) as progress:
            for slots, wait in asked:
                found.update(zip(slots, wait(), strict=True))
                progress.advance(len(slots))
        pairs = [found[slot] for slot in range(len(self))]
        return tuple(pose for pose, _ in pairs), tuple(action for _, action in pairs)

    def _portions(self) -> Iterator[tuple[int, list[int]]]:
        """The slots that each worker serves, some at a time."""
        for worker in range(len(self._workers)):
            mine = [slot for slot in range(len(self)) if self._worker_of(slot) == worker]
            for first in range(0, len(mine), _PORTION):
                yield worker, mine[first : first + _PORTION]


def _joined(parts: Sequence[NDArray[np.float32]], order: NDArray[np.int64]) -> NDArray[np.float32] | None:
    return np.concatenate(parts)[order] if parts else None


def _start(count: int, context: SourceContext, episodes: int) -> list[Worker]:
    share = context.cache_bytes // max(1, count)
    config = StagerConfig(context.generate, context.cameras, context.seed, share, episodes)
    return [WorkerProcess(config) for _ in range(count)] if count else [WorkerHere(config)]


def _digest(context: SourceContext, turnover: Turnover) -> str:
    generate = context.generate
    recipes = [recipe(generate, context.cameras, context.seed, motion) for motion in generate.motions]
    return sha256_json({"recipes": recipes, "slots": turnover.slots, "keep": turnover.keep})
