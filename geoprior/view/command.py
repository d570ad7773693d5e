"""`geoprior view EPISODE`: a contact sheet and a film of one episode."""

from __future__ import annotations

from pathlib import Path

from geoprior.shards.reader import EpisodeStore
from geoprior.view.film import episode_film, write_film
from geoprior.view.sheet import episode_sheet, write_sheet


def view_episode(episode: str, out: Path) -> list[Path]:
    """Draw the episode that a text names; see `parse_episode` and `view`."""
    return view(*parse_episode(episode), out)


def parse_episode(text: str) -> tuple[Path, str]:
    """Read ``PATH``, ``PATH:KEY`` or ``PATH:NUMBER``.

    Args:
        text: PATH is a folder of shards or one tar. What exists as a path is taken whole, colons and all.

    Returns:
        The path, and the key or the number in digits; ``0`` where nothing is said.
    """
    path, colon, episode = text.rpartition(":")
    if not colon or not path or Path(text).exists():
        return Path(text), "0"
    return Path(path), episode


def view(source: Path, key_or_index: str | int, out: Path) -> list[Path]:
    """Draw one episode into ``KEY.png``, a contact sheet, and ``KEY.webm``, a film.

    Args:
        source: A folder of shards or one tar.
        key_or_index: Which episode.
        out: Folder for the two files.

    Returns:
        The two files.

    Raises:
        DataError: The shards cannot be opened, there is no such episode, or ``out`` cannot be written.
    """
    store = EpisodeStore(source)
    episode = store.episode(store.position(key_or_index))
    sheet, film = out / f"{episode.header.key}.png", out / f"{episode.header.key}.webm"
    write_sheet(sheet, episode_sheet(episode))
    write_film(film, episode_film(episode), episode.header.fps)
    return [sheet, film]
