"""Find what `geoprior view` is pointed at: an episode in shards, or one that a config would make."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from geoprior.config import load_config
from geoprior.config_tree import find_config
from geoprior.errors import ConfigError, GeopriorError
from geoprior.hooks.manager import plugins
from geoprior.run_folder import CONFIG_FILE, saved_config
from geoprior.synthesis.studio import Studio
from geoprior.view.subject import (
    SYNTHETIC,
    Subject,
    parse_episode,
    staged_subject,
    stored_subject,
    with_points,
    without_points,
)

_YAML = {".yaml", ".yml"}
_LEVELS = 3  # a tar lies in RUN/shards/synthetic


def find_subject(text: str, overrides: Sequence[str] = (), *, points: bool = False) -> Subject:
    """Find an episode.

    Args:
        text: ``SOURCE``, ``SOURCE:KEY`` or ``SOURCE:NUMBER``. SOURCE is a folder of shards, one tar, a YAML
            config, or the name of a packaged config; what is on the disk comes before a packaged name.
        overrides: ``a.b=c`` each, for a config.
        points: Whether the points of a stored synthetic episode are wanted too.

    Returns:
        The episode; with its points if they are wanted and the config that made it is at hand.

    Raises:
        ConfigError: There is neither such a path nor such a config, the config is at fault or makes no such
            episode, or overrides were given for shards.
        DataError: The shards cannot be opened, or hold no such episode.
    """
    source, episode = parse_episode(text)
    path = Path(source)
    if path.exists() and path.suffix not in _YAML:
        if overrides:
            raise ConfigError(f"{path}: --set changes a config, and these are shards", "leave out --set")
        subject = stored_subject(path, episode)
        return _with_points(subject, path) if points else subject
    try:
        config = find_config(source)
    except ConfigError as error:
        raise ConfigError(f"{source}: no such file or folder, and no such config", error.hint) from error
    try:
        return staged_subject(_studio(config, overrides), episode)
    except ConfigError as error:
        raise ConfigError(_under(source, error.message), error.hint) from error


def _with_points(subject: Subject, path: Path) -> Subject:
    if subject.episode.header.source != SYNTHETIC:
        return subject
    config = _config_above(path)
    if config is None:
        return without_points(subject, f"there is no {CONFIG_FILE} of a run in the folders above")
    try:
        studio = _studio(config)
    except GeopriorError as error:
        return without_points(subject, error.message)
    return with_points(subject, studio)


def _studio(config: Path, overrides: Sequence[str] = ()) -> Studio:
    loaded = load_config(config, overrides, plugins())
    return Studio(loaded.generate, loaded.cameras, loaded.seed)


def _config_above(path: Path) -> Path | None:
    for folder in [path, *path.resolve().parents][: _LEVELS + 1]:
        if found := saved_config(folder):
            return found
    return None


def _under(source: str, message: str) -> str:
    return message if message.startswith(source) else f"{source}: {message}"
