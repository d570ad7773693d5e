"""The episodes that a prior is measured on, and the moments of them that are looked at."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geoprior.errors import DataError
from geoprior.geometry.se3 import apply
from geoprior.geometry.seeding import generator, integer_seed
from geoprior.motions.trajectory import ways_of_objects
from geoprior.scene.objects import OBJECT
from geoprior.sources._endless import EndlessSource
from geoprior.sources.endless import EndlessConfig
from geoprior.sources.shards import ShardSource
from geoprior.sources.source import SourceContext
from geoprior.synthesis.studio import Studio
from geoprior.training.data import chunk_steps

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.camera import CamerasConfig
    from geoprior.policies.policy import Features
    from geoprior.shards.reader import EpisodeStore
    from geoprior.sources.source import Source
    from geoprior.synthesis.config import GenerateConfig

    FloatArray = NDArray[np.float64]

MOMENTS = 3
"""Time steps of each episode, evenly spread."""
ROOT = "probe"
"""Key of the root seed of the episodes that no training of the run sees."""
_CACHE_BYTES = 128 * 2**20


@dataclass(frozen=True)
class ProbeEpisodes:
    """Some episodes of a source.

    Attributes:
        source: Where they are read.
        slots: Of the first epoch, E of them.
        motions: (E) the motion or task of each.
        told: What they are, for people.
        object_places: From a place in ``slots`` and its time steps (T,) to where each camera sees the
            object's centre, (T, 2) right and down of the camera's frame, metres; None where nobody knows.
    """

    source: Source
    slots: Sequence[int]
    motions: Sequence[str]
    told: str
    object_places: Callable[[int, NDArray[np.int64]], Mapping[str, FloatArray]] | None = None

    def __len__(self) -> int:
        return len(self.slots)


@dataclass(frozen=True)
class Rows:
    """M moments of some episodes, `MOMENTS` of each, one episode's after the other's.

    Attributes:
        episodes: (M,) places in `ProbeEpisodes.slots`.
        slots: (M,) of the source.
        steps: (M, 1 + chunk) time steps; see `geoprior.training.data.chunk_steps`.
        valid: (M, chunk) whether an action lies within its episode.
        partners: (M,) the row whose images stand in when images are shuffled: of another episode of the same
            motion, at a like time.
    """

    episodes: NDArray[np.int64]
    slots: NDArray[np.int64]
    steps: NDArray[np.int64]
    valid: NDArray[np.bool_]
    partners: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.slots)


def rows_of(episodes: ProbeEpisodes, features: Features, skip: int) -> Rows:
    """The moments that are looked at: a pure function of the episodes' lengths and motions.

    Raises:
        DataError: A motion has one episode only, so that no other one's images can stand in.
    """
    partner = partners_of(episodes.motions, episodes.told)
    places = np.repeat(np.arange(len(episodes)), MOMENTS)
    slots = np.asarray(episodes.slots)[places]
    lengths = np.array([len(episodes.source.poses[slot]) for slot in slots])
    number = np.tile(np.arange(MOMENTS), len(episodes))
    times = ((number + 0.5) / MOMENTS * lengths).astype(np.int64)
    steps, valid = chunk_steps(times, lengths, features.chunk, skip)
    return Rows(places, slots, steps, valid, partner[places] * MOMENTS + number)


def partners_of(motions: Sequence[str], told: str = "the data") -> NDArray[np.int64]:
    """For each episode another one of the same motion; every episode is one's partner.

    Raises:
        DataError: A motion has one episode only.
    """
    names = np.array(motions)
    partner = np.empty(len(names), np.int64)
    for name in sorted(set(motions)):
        members = np.flatnonzero(names == name)
        if len(members) < 2:
            raise DataError(
                f"{told}: motion {name!r} has one episode, and shuffling images takes two at least",
                "give more episodes of it: --episodes, or another --data",
            )
        order = generator(0, ROOT, "partners", name).permutation(members)
        partner[order] = np.roll(order, -1)
    return partner


def fresh_episodes(generate: GenerateConfig, cameras: CamerasConfig, seed: int, count: int) -> ProbeEpisodes:
    """Synthetic episodes of a run's recipe that none of its trainings sees, made when they are read.

    Args:
        generate: The run's.
        cameras: The run's.
        seed: Root seed of the run; the episodes have one of their own.
        count: Episodes of each motion.

    Raises:
        GeopriorError: An episode cannot be staged.
    """
    root = integer_seed(seed, ROOT)
    source = generated_source(generate, cameras, root, count)
    motions = [motion.name for _ in range(count) for motion in generate.motions]
    studio = Studio(generate, cameras, root, count)

    def object_places(place: int, steps: NDArray[np.int64]) -> dict[str, FloatArray]:
        index, turn = divmod(place, len(generate.motions))
        take = studio.stage(generate.motions[turn], index)
        way = ways_of_objects(take.scene, take.trajectory)[OBJECT]
        centres = np.broadcast_to(way, (take.trajectory.steps, 4, 4))[steps, None, :3, 3]
        return {
            name: apply(shot.at(steps).view.transforms_world_to_camera, centres)[:, 0, :2]
            for name, shot in take.shots.items()
        }

    told = f"{count} fresh synthetic episodes of each motion"
    return ProbeEpisodes(source, range(len(source)), motions, told, object_places)


def generated_source(
    generate: GenerateConfig, cameras: CamerasConfig, root: int, count: int
) -> EndlessSource:
    """The first ``count`` episodes of each motion that a root seed gives, in this process."""
    context = SourceContext(Path(), generate, cameras, root, _CACHE_BYTES)
    return EndlessSource(EndlessConfig(episodes=count, keep=1, workers=0), context, quiet=True)


def stored_episodes(
    store: EpisodeStore, told: str, slots: Sequence[int] | None = None, most: int | None = None
) -> ProbeEpisodes:
    """Episodes on disk.

    Args:
        store: Where they are.
        told: What they are.
        slots: Those to take; all by default.
        most: Of each motion; the first ones are taken.
    """
    taken: list[int] = []
    motions: list[str] = []
    for slot in range(len(store)) if slots is None else slots:
        motion = store.header(slot).motion
        if most is None or motions.count(motion) < most:
            taken.append(slot)
            motions.append(motion)
    return ProbeEpisodes(ShardSource(store), taken, motions, told)
