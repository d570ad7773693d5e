"""From episodes on disk to normalised batches, in an order that depends on seed and step only."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import torch

from geoprior.geometry.seeding import generator
from geoprior.policies.normalise import FeatureStatistics, Normaliser, measure, normalise_images
from geoprior.policies.policy import Batch, Features
from geoprior.training.frames import FrameReader, FrameSource, add_noise, shift_frames
from geoprior.training.order import SampleOrder

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.training.config import TrainConfig


class Store(FrameSource, Protocol):
    """What training needs of `geoprior.shards.reader.EpisodeStore`."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names in alphabetical order."""
        ...

    @property
    def fps(self) -> float:
        """Time steps a second."""
        ...

    @property
    def image_size(self) -> tuple[int, int]:
        """(height, width) of every camera."""
        ...

    @property
    def digest(self) -> str:
        """Fingerprint of the data."""
        ...

    def __len__(self) -> int: ...

    def pose(self, i: int) -> NDArray[np.float32]:
        """(N, pose_size) of episode ``i``."""
        ...

    def action(self, i: int) -> NDArray[np.float32]:
        """(N, pose_size) of episode ``i``."""
        ...


@dataclass(frozen=True)
class Demonstrations:
    """A store with its poses and actions in memory; frames stay on disk until they are needed.

    Attributes:
        store: Where the frames are.
        poses: Per episode (N, pose_size) float32, raw.
        actions: The same shapes.
    """

    store: Store
    poses: tuple[NDArray[np.float32], ...]
    actions: tuple[NDArray[np.float32], ...]

    @classmethod
    def load(cls, store: Store) -> Demonstrations:
        """Read all poses and actions."""
        episodes = range(len(store))
        return cls(store, tuple(store.pose(i) for i in episodes), tuple(store.action(i) for i in episodes))

    def features(self, chunk: int) -> Features:
        """What a policy of that chunk sees and says here."""
        return Features(self.store.cameras, self.store.image_size, self.poses[0].shape[1], chunk)

    def statistics(self) -> dict[str, FeatureStatistics]:
        """Over all time steps."""
        return {"pose": measure(self.poses), "action": measure(self.actions)}


class Batches:
    """The batches of one training.

    Args:
        demonstrations: Raw.
        features: Chunk and cameras.
        normaliser: Applied to poses and actions.
        config: Batch size, skip, noise and shift.
        seed: Of the training; decides order, noise and shift.
    """

    def __init__(
        self,
        demonstrations: Demonstrations,
        features: Features,
        normaliser: Normaliser,
        config: TrainConfig,
        seed: int,
    ) -> None:
        cache_bytes = config.frame_cache_mb * 2**20
        self._frames = FrameReader(demonstrations.store, features.cameras, cache_bytes)
        self._features, self._config, self._seed = features, config, seed
        self._poses = [normaliser.normalise("pose", pose) for pose in demonstrations.poses]
        self._actions = [normaliser.normalise("action", action) for action in demonstrations.actions]
        self._order = SampleOrder(seed, [len(pose) for pose in self._poses])

    def batch(self, step: int) -> Batch:
        """The batch of optimiser step ``step``, from 0."""
        size = self._config.batch_size
        samples = self._order.samples(step * size, size)
        rng = generator(self._seed, "augment", step)
        poses = np.stack([self._poses[episode][time] for episode, time in samples])
        chunks = [self._chunk(episode, time) for episode, time in samples]
        frames = self._frames.read(samples)
        if self._config.image_shift:
            frames = shift_frames(frames, self._config.image_shift, rng)
        return {
            "pose": torch.from_numpy(poses),
            "images": normalise_images(add_noise(frames, self._config.image_noise, rng)),
            "action": torch.from_numpy(np.stack([actions for actions, _ in chunks])),
            "valid": torch.from_numpy(np.stack([valid for _, valid in chunks])),
        }

    def stream(self, first: int, last: int) -> Iterator[Batch]:
        """The batches of the steps ``first .. last - 1``, read ahead by a thread if the config says so."""
        if self._config.prefetch == 0:
            yield from map(self.batch, range(first, last))
            return
        with ThreadPoolExecutor(1, thread_name_prefix="batches") as pool:
            ahead: deque[Future[Batch]] = deque()
            try:
                for step in range(first, last):
                    ahead.append(pool.submit(self.batch, step))
                    if len(ahead) > self._config.prefetch:
                        yield ahead.popleft().result()
                while ahead:
                    yield ahead.popleft().result()
            finally:
                for future in ahead:
                    future.cancel()

    def _chunk(self, episode: int, time: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        return chunk_of(self._actions[episode], time, self._features.chunk, self._config.skip)


def chunk_of(
    actions: NDArray[np.float32], time: int, chunk: int, skip: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The actions ``time, time + skip, ...``; after the end the last one repeats, marked as not valid.

    Args:
        actions: (N, channels).
        time: First step, in [0, N).
        chunk: How many.
        skip: Steps from one to the next.

    Returns:
        (chunk, channels) and (chunk,) bool.
    """
    indices = time + skip * np.arange(chunk)
    return actions[np.minimum(indices, len(actions) - 1)], indices < len(actions)
