"""From a source's episodes to normalised batches, in an order that depends on seed and step only."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import reduce
from itertools import starmap
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np
import torch

from geoprior.errors import ConfigError
from geoprior.geometry.seeding import generator
from geoprior.lanes import stay_alone
from geoprior.policies.normalise import (
    FeatureStatistics,
    Normaliser,
    measure,
    merge,
    normalise_images,
    origins,
)
from geoprior.policies.policy import Batch, Features
from geoprior.policies.predictor import stack_cameras
from geoprior.policies.targets import scale_targets
from geoprior.sources.source import targets_of
from geoprior.training.frames import add_noise, shift_frames
from geoprior.training.order import SampleOrder

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.policies.policy import ActionKind
    from geoprior.sources.source import Moments, Source
    from geoprior.training.config import TrainConfig


def features_of(source: Source, chunk: int, *, targets: bool = False) -> Features:
    """What a policy of that chunk sees and says here; with ``targets`` it learns the source's on the side."""
    names = targets_of(source) if targets else ()
    return Features(source.cameras, source.image_size, source.hands, chunk, names)


def statistics_of(
    source: Source,
    slots: Sequence[int] | None = None,
    *,
    actions: ActionKind = "absolute",
    chunk: int = 1,
    skip: int = 1,
) -> dict[str, FeatureStatistics]:
    """Over all time steps of the first epoch's episodes, or of those in some slots.

    Args:
        source: Of the episodes.
        slots: Those that count; all by default.
        actions: `absolute` ones count once each; `relative` ones once in every chunk that they are part of.
        chunk: Actions of a chunk.
        skip: Steps from one to the next.
    """
    chosen = range(len(source)) if slots is None else slots
    pose = measure([source.poses[slot] for slot in chosen])
    if actions == "absolute":
        return {"pose": pose, "action": measure([source.actions[slot] for slot in chosen])}
    rows = (_relative_rows(source.poses[slot], source.actions[slot], chunk, skip) for slot in chosen)
    return {"pose": pose} | reduce(merge, ({"action": measure([of_episode])} for of_episode in rows))


def _relative_rows(
    poses: NDArray[np.float32], actions: NDArray[np.float32], chunk: int, skip: int
) -> NDArray[np.float32]:
    """(rows, pose_size): the valid actions of the chunks of all time steps, relative ones."""
    lengths = np.full(len(poses), len(poses))
    steps, valid = chunk_steps(np.arange(len(poses)), lengths, chunk, skip)
    relative = actions[steps[:, 1:]] - origins(poses, "relative")
    return np.asarray(relative[valid], np.float32)


def split_slots(count: int, share: float, seed: int) -> tuple[list[int], list[int]]:
    """The slots to train on, and those that are held out.

    Args:
        count: Slots of the source.
        share: To be held out; above 0 at least one slot is, and at least one is left.
        seed: Of the training.

    Raises:
        ConfigError: There are too few episodes for both.
    """
    if share == 0.0:
        return list(range(count)), []
    aside = min(max(1, round(share * count)), count - 1)
    if aside < 1:
        raise ConfigError(
            f"held_out {share:g}: {count} episode cannot be trained on and held out", "set held_out to 0"
        )
    order = generator(seed, "held-out").permutation(count).tolist()
    return sorted(order[aside:]), sorted(order[:aside])


class Batches:
    """The batches of one training.

    Args:
        source: Where the episodes come from.
        features: Chunk and cameras.
        normaliser: Applied to poses and actions.
        config: Batch size, skip, noise and shift.
        seed: Of the training; decides order, noise and shift.
        slots: Those of the source to train on; all by default.
    """

    def __init__(
        self,
        source: Source,
        features: Features,
        normaliser: Normaliser,
        config: TrainConfig,
        seed: int,
        slots: Sequence[int] | None = None,
    ) -> None:
        self._source, self._features, self._normaliser = source, features, normaliser
        self._config, self._seed = config, seed
        self._slots = np.arange(len(source)) if slots is None else np.array(slots)
        self._lengths = np.array([len(pose) for pose in source.poses])
        self._order = SampleOrder(seed, self._lengths[self._slots].tolist(), config.early)
        self._reading = Lock()

    def batch(self, step: int, part: int = 0) -> Batch:
        """A microbatch of the batch of optimiser step ``step``, both from 0."""
        parts = self._config.microbatches
        size = self._config.batch_size // parts
        first = (step * parts + part) * size
        positions = np.arange(first, first + size)
        places, times = self._order.samples(first, size).T
        slots = self._slots[places]
        numbers = positions // len(self._slots) * len(self._source) + slots
        steps, valid = chunk_steps(times, self._lengths[slots], self._features.chunk, self._config.skip)
        moments = self.read(numbers, steps)
        rng = generator(self._seed, "augment", *_number(step, part, parts))
        frames = stack_cameras(moments.frames, self._features.cameras)
        if self._config.image_shift:
            frames = shift_frames(frames, self._config.image_shift, rng)
        noisy = add_noise(frames, self._config.image_noise, rng)
        return make_batch(moments, noisy, valid, self._normaliser, self._features.targets)

    def read(self, numbers: NDArray[np.int64], steps: NDArray[np.int64]) -> Moments:
        """What the source reads, one caller at a time: it need not know of threads."""
        with self._reading:
            return self._source.read(numbers, steps)

    def stream(self, first: int, last: int, parts: Sequence[int] = (0,)) -> Generator[Batch, None, None]:
        """Some microbatches of each of the steps ``first .. last - 1``, one after the other.

        They are prepared ahead by threads if the config says so. A batch depends on its numbers alone, so it
        does not matter which thread makes it, or when.
        """
        wanted = ((step, part) for step in range(first, last) for part in parts)
        if self._config.prefetch == 0 or self._config.loader_workers == 0:
            yield from starmap(self.batch, wanted)
            return
        workers = self._config.loader_workers
        with ThreadPoolExecutor(workers, thread_name_prefix="batches", initializer=stay_alone) as pool:
            ahead: deque[Future[Batch]] = deque()
            try:
                for step, part in wanted:
                    ahead.append(pool.submit(self.batch, step, part))
                    if len(ahead) > self._config.prefetch:
                        yield ahead.popleft().result()
                while ahead:
                    yield ahead.popleft().result()
            finally:
                for future in ahead:
                    future.cancel()


def make_batch(
    moments: Moments,
    frames: torch.Tensor,
    valid: NDArray[np.bool_],
    normaliser: Normaliser,
    targets: Sequence[str] = (),
) -> Batch:
    """Normalise what a policy learns from.

    Args:
        moments: As the source gives them for `chunk_steps`; their frames are not looked at.
        frames: (B, cameras, H, W, C) as recorded, perhaps noisy.
        valid: (B, C) whether an action lies within its episode.
        normaliser: Of the training.
        targets: Names of the moments' targets, where the policy learns them.
    """
    batch: Batch = {
        "pose": torch.from_numpy(normaliser.normalise("pose", moments.pose)),
        "images": normalise_images(frames),
        "action": torch.from_numpy(normaliser.normalise_actions(moments.pose, moments.action[:, 1:])),
        "valid": torch.from_numpy(valid),
    }
    if targets and moments.targets is not None:
        batch["targets"] = torch.from_numpy(scale_targets(targets, moments.targets))
    return batch


def _number(step: int, part: int, parts: int) -> tuple[int, ...]:
    """What tells the random draws of a microbatch from all others."""
    return (step,) if parts == 1 else (step, part)


def chunk_steps(
    times: NDArray[np.int64], lengths: NDArray[np.int64], chunk: int, skip: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The time steps of a sample: t, where it is seen, and those of its actions.

    Of the ``skip`` steps that make one of the policy's, the last one's action counts: it says where the hand
    shall be when the policy is asked again. After the end the last one repeats, marked as not valid.

    Args:
        times: (B,) t, each in [0, N) of its episode.
        lengths: (B,) N.
        chunk: How many actions.
        skip: Steps from one to the next.

    Returns:
        (B, 1 + chunk) and (B, chunk) bool.
    """
    begins = times[:, None] + skip * np.arange(chunk)
    ends = lengths[:, None]
    steps = np.hstack([times[:, None], begins + skip - 1])
    return np.minimum(steps, ends - 1), begins < ends
