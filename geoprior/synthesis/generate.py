"""The stage that makes the geometric data set: whole shards, side by side, the same bytes each time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from geoprior.errors import DataError
from geoprior.progress import track
from geoprior.shards.manifest import write_manifest
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.writer import write_samples
from geoprior.synthesis.studio import Studio, recipe

if TYPE_CHECKING:
    from pathlib import Path

    from geoprior.geometry.camera import CamerasConfig
    from geoprior.hooks.types import Executor
    from geoprior.options import Choice
    from geoprior.shards.manifest import Manifest, ShardRecord
    from geoprior.synthesis.config import GenerateConfig


@dataclass(frozen=True)
class ShardTask:
    """One shard to make: a unit of work that any process can do.

    Attributes:
        path: Where it goes.
        config: The data set's config.
        cameras: Lenses and size of the frames.
        seed: Root seed.
        episodes: Motion and number of each episode, in the shard's order.
    """

    path: Path
    config: GenerateConfig
    cameras: CamerasConfig
    seed: int
    episodes: tuple[tuple[Choice, int], ...]

    @property
    def keys(self) -> list[str]:
        """The keys of the shard's samples."""
        return [f"{motion.name}-{index:06d}" for motion, index in self.episodes]


def plan_shards(config: GenerateConfig, cameras: CamerasConfig, seed: int, out: Path) -> list[ShardTask]:
    """Cut the data set into shards. Motions take turns, so that a shard of some episodes has them all."""
    episodes = [(motion, index) for index in range(config.episodes) for motion in config.motions]
    size = config.episodes_per_shard
    return [
        ShardTask(
            path=out / f"synthetic-{number:06d}.tar",
            config=config,
            cameras=cameras,
            seed=seed,
            episodes=tuple(episodes[first : first + size]),
        )
        for number, first in enumerate(range(0, len(episodes), size))
    ]


def make_shard(task: ShardTask) -> ShardRecord:
    """Make one shard, an episode at a time in memory."""
    studio = Studio(task.config, task.cameras, task.seed)
    return write_samples(task.path, (studio.sample(motion, index) for motion, index in task.episodes))


def generate(
    config: GenerateConfig, cameras: CamerasConfig, *, seed: int, executor: Executor, out: Path
) -> Manifest:
    """Make the data set, or what is still missing of it.

    A shard that is there is whole, since it came there by a rename; it is hashed again and kept.

    Args:
        config: What to make.
        cameras: Lenses and size of the frames.
        seed: Root seed.
        executor: Runs the shards side by side; the bytes do not depend on it.
        out: Folder of the shards and their manifest.

    Raises:
        ConfigError: A name or an option is unknown, or the config leaves no room for a scene.
        DataError: The folder cannot be written, or holds a shard of another config.
    """
    tasks = plan_shards(config, cameras, seed, out)
    records = {number: _kept(task) for number, task in enumerate(tasks) if task.path.exists()}
    missing = [number for number in range(len(tasks)) if number not in records]
    total = config.episodes * len(config.motions)
    done = sum(len(record.samples) for record in records.values())
    with track("generate", total, "episodes", done=done) as progress:
        for position, record in executor.run(make_shard, [tasks[number] for number in missing]):
            records[missing[position]] = record
            progress.advance(len(record.samples))
    return write_manifest(out, [records[number] for number in range(len(tasks))])


def _kept(task: ShardTask) -> ShardRecord:
    store = EpisodeStore(task.path)
    if list(store.keys) != task.keys or not _has_recipes(store, task):
        raise DataError(
            f"{task.path}: this shard was made from another config",
            "delete the folder, or choose another one",
        )
    return store.manifest.shards[0]


def _has_recipes(store: EpisodeStore, task: ShardTask) -> bool:
    """Whether an episode of each motion was made as it would be now."""
    places = {motion.name: place for place, (motion, _) in enumerate(task.episodes)}
    return all(
        store.header(place).details.get("recipe")
        == recipe(task.config, task.cameras, task.seed, task.episodes[place][0])
        for place in places.values()
    )
