"""`geoprior view` and `geoprior shards preview`: files for people to look at."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from geoprior.errors import ConfigError
from geoprior.shards.reader import EpisodeStore
from geoprior.view.film import episode_film, write_film
from geoprior.view.orbit import Angle
from geoprior.view.sheet import episode_sheet, store_sheet, write_sheet
from geoprior.view.space import space_film, space_picture
from geoprior.view.world import world_of

if TYPE_CHECKING:
    from geoprior.view.subject import Subject

NO_FILM = "none"


@dataclass(frozen=True)
class Look:
    """How an episode is to be drawn.

    Attributes:
        film: Kind of the films: ``webm``, ``mp4``, ``gif``; or ``none``.
        angle: From where it is drawn in space as well; None for not at all.
        orbit: Degrees of azimuth that the film in space goes round.
        wide: Whether the whole floor and the fixed cameras are in the pictures in space.
    """

    film: str = "webm"
    angle: Angle | None = None
    orbit: float = 0.0
    wide: bool = False

    @classmethod
    def of(
        cls,
        *,
        film: str = "webm",
        space: bool = False,
        azimuth: float | None = None,
        elevation: float | None = None,
        orbit: float | None = None,
        wide: bool = False,
    ) -> Look:
        """Check what a user says; anything that is said of the view in space asks for it.

        Raises:
            ConfigError: A number is out of range.
        """
        _require_range("--azimuth", azimuth, 3600.0)
        _require_range("--elevation", elevation, 90.0)
        _require_range("--orbit", orbit, 3600.0)
        asked = space or wide or any(value is not None for value in (azimuth, elevation, orbit))
        usual = Angle()
        angle = Angle(
            usual.azimuth if azimuth is None else azimuth,
            usual.elevation if elevation is None else elevation,
        )
        return cls(film, angle if asked else None, orbit or 0.0, wide)


def draw(subject: Subject, out: Path, look: Look) -> list[Path]:
    """Draw one episode.

    Args:
        subject: What to draw.
        out: Folder for the files: ``KEY.png``, a contact sheet; ``KEY.webm`` or of another kind, a film; and
            in space ``KEY-3d.png`` and ``KEY-3d.webm``.
        look: How.

    Returns:
        The files.

    Raises:
        ConfigError: There are no films of that kind.
        DataError: ``out`` cannot be written.
        MachineError: OpenCV was built without the codec.
    """
    episode, angle = subject.episode, look.angle
    key, fps = episode.header.key, episode.header.fps
    sheets = {key: episode_sheet(episode)}
    films = {key: episode_film(episode)}
    if angle is not None:
        world = world_of(episode.header, episode.pose, subject.bodies)
        sheets[f"{key}-3d"] = space_picture(episode, world, angle, wide=look.wide)
        films[f"{key}-3d"] = space_film(episode, world, angle, look.orbit, wide=look.wide)
    written = []
    for name, sheet in sheets.items():
        written.append(out / f"{name}.png")
        write_sheet(written[-1], sheet)
    for name, film in films.items() if look.film != NO_FILM else ():
        written.append(out / f"{name}.{look.film}")
        write_film(written[-1], film, fps)
    return written


def preview(source: Path, out: Path | None, rows: int, columns: int) -> Path:
    """Draw a sheet of a whole data set: some of its episodes, the motions in turn.

    Args:
        source: A folder of shards or one tar.
        out: The PNG; without it, one in the current folder with the source's name.
        rows: Episodes shown.
        columns: Steps shown of each camera.

    Raises:
        DataError: The shards cannot be opened, or ``out`` cannot be written.
    """
    store = EpisodeStore(source)
    path = out or Path(f"{source.resolve().name.removesuffix('.tar')}.png")
    write_sheet(path, store_sheet(store, rows, columns))
    return path


def _require_range(option: str, value: float | None, most: float) -> None:
    if value is not None and not (math.isfinite(value) and abs(value) <= most):
        raise ConfigError(f"{option} {value:g}: out of range", f"degrees from {-most:g} to {most:g}")
