"""Contact sheets: an episode, or a whole data set, at one look."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from geoprior.files import write_bytes
from geoprior.shards.codec import encode_png
from geoprior.view.canvas import FAINT, GAP, below, beside, caption, fit, framed, to_rgb
from geoprior.view.captions import episode_caption, step_caption

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from geoprior.episode import Episode
    from geoprior.shards.reader import EpisodeStore


def episode_sheet(episode: Episode, columns: int = 8, cell: int = 192) -> NDArray[np.uint8]:
    """Draw an episode: a row for each camera, a column for each of some evenly spaced steps.

    Args:
        episode: What to draw.
        columns: Steps shown; fewer if the episode is shorter. The first and the last are among them.
        cell: Largest height of a frame, in pixels.

    Returns:
        (height, width, 3) uint8 RGB.
    """
    header = episode.header
    parts = []
    for step in evenly_spaced(header.steps, columns):
        frames = [fit(to_rgb(episode.images[camera.name][step]), cell) for camera in header.cameras]
        width = max(frame.shape[1] for frame in frames)
        words = [word for word in step_caption(header, episode.pose, step) if word]
        parts.append(below([*frames, caption(words, width, FAINT)]))
    steps = beside(parts)
    names = "rows: " + ", ".join(camera.name for camera in header.cameras)
    return framed(below([caption([episode_caption(header), names], steps.shape[1]), steps]))


def store_sheet(store: EpisodeStore, rows: int = 9, columns: int = 5, cell: int = 96) -> NDArray[np.uint8]:
    """Draw a data set: a row for each of some episodes, the motions in turn, every camera side by side.

    Args:
        store: What to draw.
        rows: Episodes shown; fewer if the store is smaller.
        columns: Steps shown of each camera.
        cell: Largest height of a frame, in pixels.

    Returns:
        (height, width, 3) uint8 RGB.
    """
    parts = [_store_row(store, i, columns, cell) for i in representative(store, rows)]
    width = max(part.shape[1] for part in parts)
    title = f"{len(store)} episodes at {store.fps:g} Hz  ·  left to right: {', '.join(store.cameras)}"
    return framed(below([caption([title], width), *parts], 2 * GAP))


def write_sheet(path: Path, sheet: NDArray[np.uint8]) -> None:
    """Write a sheet as PNG, atomically.

    Raises:
        DataError: The folder cannot be written.
    """
    write_bytes(path, encode_png(sheet))


def evenly_spaced(count: int, most: int) -> list[int]:
    """At most ``most`` of ``range(count)``, the first and the last among them."""
    if most < 2:
        return [0][: min(most, count)]
    return sorted(set(np.linspace(0, count - 1, min(most, count)).round().astype(int).tolist()))


def representative(store: EpisodeStore, most: int) -> list[int]:
    """Numbers of at most ``most`` episodes: every motion in turn, evenly spaced within each."""
    by_motion: dict[str, list[int]] = defaultdict(list)
    for i in range(len(store)):
        by_motion[store.header(i).motion].append(i)
    share = -(-most // len(by_motion))
    picks = [
        [numbers[j] for j in evenly_spaced(len(numbers), share)] for _, numbers in sorted(by_motion.items())
    ]
    in_turn = [column[turn] for turn in range(share) for column in picks if turn < len(column)]
    return in_turn[:most]


def _store_row(store: EpisodeStore, i: int, columns: int, cell: int) -> NDArray[np.uint8]:
    header = store.header(i)
    steps = evenly_spaced(header.steps, columns)
    groups = [
        beside([fit(to_rgb(frame), cell) for frame in store.frames(i, camera, steps)], GAP // 2)
        for camera in store.cameras
    ]
    frames = beside(groups, 4 * GAP)
    return below([caption([episode_caption(header)], frames.shape[1], FAINT), frames], 0)
