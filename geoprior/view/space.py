"""An episode in space, from any angle: one picture of its whole way, or a film of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from geoprior.view.canvas import below, beside, caption, fit, framed, legend, to_rgb
from geoprior.view.captions import episode_caption, line_of, step_caption
from geoprior.view.orbit import Angle, views_around
from geoprior.view.painter import paint
from geoprior.view.palette import AXES, CAMERA, FLOOR, HAND, OBJECT, Colour, colour_of
from geoprior.view.scenery import extent, marks_of
from geoprior.view.sheet import evenly_spaced

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.episode import Episode
    from geoprior.view.world import World

FILM_SIZE = (480, 640)
PICTURE_SIZE = (720, 960)
_GHOSTS = 3
_AHEAD = 0.35
_NAME_HEIGHT = 22


def space_picture(
    episode: Episode,
    world: World,
    angle: Angle,
    *,
    wide: bool = False,
    size: tuple[int, int] = PICTURE_SIZE,
) -> NDArray[np.uint8]:
    """Draw an episode in space: its last step, its whole way, and what moves at some steps before, fainter.

    Args:
        episode: What the caption tells.
        world: What to draw.
        angle: From where.
        wide: See `extent`.
        size: Rows and columns of the picture without its captions.

    Returns:
        (height, width, 3) uint8 RGB.
    """
    picture = space_view(world, angle, wide=wide, size=size)
    width = picture.shape[1]
    title = caption([episode_caption(episode.header)], width)
    return framed(below([title, picture, legend(meanings(world), width)]))


def space_view(
    world: World, angle: Angle, *, wide: bool = False, size: tuple[int, int] = PICTURE_SIZE
) -> NDArray[np.uint8]:
    """The same picture without its captions."""
    view = views_around(extent(world, wide=wide), [angle], size)[0]
    ghosts = evenly_spaced(world.steps, _GHOSTS + 1)[:-1]
    return paint(marks_of(world, world.steps - 1, ghosts), view)


def space_film(
    episode: Episode,
    world: World,
    angle: Angle,
    orbit: float = 0.0,
    *,
    wide: bool = False,
    size: tuple[int, int] = FILM_SIZE,
) -> Iterator[NDArray[np.uint8]]:
    """Yield a frame for each step: the world in space beside what every camera sees.

    Args:
        episode: What the cameras see, and what the captions tell.
        world: What to draw.
        angle: From where at the first step.
        orbit: Degrees of azimuth to go round in the whole film; 360 makes a loop.
        wide: See `extent`.
        size: Rows and columns of the part in space.

    Yields:
        (height, width, 3) uint8 RGB.
    """
    header = episode.header
    turns = [orbit * step / world.steps for step in range(world.steps)] if orbit else [0.0]
    views = views_around(extent(world, wide=wide), [angle.turned(turn) for turn in turns], size)
    cell = max(1, size[0] // len(header.cameras) - _NAME_HEIGHT)
    colours = None
    for step in range(world.steps):
        picture = paint(marks_of(world, step, ahead=_AHEAD), views[step % len(views)])
        seen = [_named(camera.name, episode.images[camera.name][step], cell) for camera in header.cameras]
        shown = beside([picture, below(seen)])
        width = shown.shape[1]
        colours = legend(meanings(world), width) if colours is None else colours
        words = line_of(step_caption(header, episode.pose, step))
        lines = caption([episode_caption(header), words], width)
        yield framed(below([shown, lines, colours]))


def meanings(world: World) -> dict[str, Colour]:
    """What the colours of a world's picture mean."""
    bodies = {cloud.body: colour_of(cloud.body) for cloud in world.bodies.clouds}
    if not bodies:
        bodies = {"floor": FLOOR, **({"object's box": OBJECT} if world.objects else {}), "hand": HAND}
    return {**bodies, "cameras": CAMERA, **AXES}


def _named(name: str, frame: NDArray[np.uint8], cell: int) -> NDArray[np.uint8]:
    shown = fit(to_rgb(frame), cell)
    return below([caption([name], shown.shape[1]), shown], 0)
