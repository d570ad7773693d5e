"""What is drawn: an episode, from a disk or made on the spot, and its points where they can be had."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geoprior import __version__
from geoprior.errors import ConfigError, GeopriorError
from geoprior.shards.reader import EpisodeStore
from geoprior.view.world import Bodies, bodies_of

if TYPE_CHECKING:
    from geoprior.episode import Episode
    from geoprior.options import Choice
    from geoprior.synthesis.studio import Studio

SYNTHETIC = "synthetic"
_SAME_POSE = 1e-5  # metres and quaternion components: what another processor may round otherwise


@dataclass(frozen=True)
class Subject:
    """An episode to be drawn.

    Attributes:
        episode: In memory.
        bodies: Its points and surfaces; None where nobody knows them.
        remark: Why the points of a synthetic episode are not there, in a line; else empty.
    """

    episode: Episode
    bodies: Bodies | None = None
    remark: str = ""


def parse_episode(text: str) -> tuple[str, str]:
    """Read ``SOURCE``, ``SOURCE:KEY`` or ``SOURCE:NUMBER``.

    Args:
        text: SOURCE is a folder of shards, one tar, or a config. What exists as a path is taken whole, colons
            and all.

    Returns:
        The source, and the key or the number in digits; ``0`` where nothing is said.
    """
    source, colon, episode = text.rpartition(":")
    if not colon or not source or Path(text).exists():
        return text, "0"
    return source, episode


def stored_subject(path: Path, episode: str) -> Subject:
    """An episode of a folder of shards, or of one tar, without its points.

    Raises:
        DataError: The shards cannot be opened, or there is no such episode.
    """
    store = EpisodeStore(path)
    return Subject(store.episode(store.position(episode)))


def staged_subject(studio: Studio, episode: str) -> Subject:
    """An episode of the data set that a studio would make, made now and kept nowhere.

    Args:
        studio: Of the data set.
        episode: Its key, or its number in the data set, where the motions take turns.

    Raises:
        ConfigError: There is no such episode, or the config leaves no room for it.
    """
    motion, index = _find(studio, episode)
    return Subject(studio.episode(motion, index), bodies_of(studio.stage(motion, index)))


def with_points(subject: Subject, studio: Studio) -> Subject:
    """The same episode with its points made again, or a remark on why that cannot be.

    Args:
        subject: A stored synthetic episode.
        studio: Of the config that is said to have made it.
    """
    header = subject.episode.header
    motions = {choice.name: choice for choice in studio.config.motions}
    if header.motion not in motions:
        return without_points(subject, f"the config knows no motion {header.motion!r}")
    try:
        recipe = studio.recipe(motions[header.motion])
        if recipe != header.details.get("recipe"):
            return without_points(subject, f"the run's config would make another episode{_versions(subject)}")
        take = studio.stage(motions[header.motion], header.index)
    except GeopriorError as error:
        return without_points(subject, error.message)
    pose = take.trajectory.pose()
    if not np.allclose(pose, subject.episode.pose, rtol=0.0, atol=_SAME_POSE):
        return without_points(subject, f"this geoprior makes other poses from its recipe{_versions(subject)}")
    return replace(subject, bodies=bodies_of(take))


def without_points(subject: Subject, reason: str) -> Subject:
    """The same episode with a remark on why its points cannot be made again."""
    key = subject.episode.header.key
    return replace(subject, remark=f"{key}: drawn without points, which cannot be made again: {reason}")


def _find(studio: Studio, episode: str) -> tuple[Choice, int]:
    """Motion and number of an episode, by its key or by its number in the data set."""
    motions, count = studio.config.motions, studio.config.episodes
    if episode.isdecimal() and int(episode) < count * len(motions):
        index, turn = divmod(int(episode), len(motions))
        return motions[turn], index
    by_name = {choice.name: choice for choice in motions}
    name, _, number = episode.rpartition("-")
    if name in by_name and len(number) == 6 and number.isdecimal() and int(number) < count:
        return by_name[name], int(number)
    first, last = f"{motions[0].name}-000000", f"{motions[-1].name}-{count - 1:06d}"
    near = difflib.get_close_matches(name, by_name, n=1)
    hint = f"did you mean {near[0]}-{number or '000000'}? " if near and name not in by_name else ""
    hint += f"its config makes {count * len(motions)}: {first} to {last}; motions: {', '.join(by_name)}"
    raise ConfigError(f"no episode {episode!r}", hint)


def _versions(subject: Subject) -> str:
    made, here = subject.episode.header.generator, f"geoprior {__version__}"
    return "" if made == here else f" ({made} made this one, and this is {here})"
