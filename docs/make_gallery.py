"""Draw every registered primitive, motion and variant, and the options; write the page that shows them.

GEOPRIOR_PLUGINS= python docs/make_gallery.py      the built-in ones: docs/gallery.md and docs/images/gallery
python docs/make_gallery.py FOLDER                 those of your plug-ins too, into a folder of your own
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from gallery_options import OPTIONS, Option, option_picture

from geoprior.config import RunConfig, load_config
from geoprior.hooks.manager import Plugins, plugins
from geoprior.options import Choice
from geoprior.synthesis.studio import Studio
from geoprior.view.canvas import below, beside, framed, to_rgb
from geoprior.view.film import write_film
from geoprior.view.orbit import Angle
from geoprior.view.reduction import reduced
from geoprior.view.sheet import episode_sheet
from geoprior.view.space import space_film, space_picture, space_view
from geoprior.view.world import bodies_of, world_of

DOCS = Path(__file__).parent
IMAGES = Path("images") / "gallery"
CONFIG = "lite"
SETTINGS = ["seed=6", "cameras.height=96", "cameras.width=96"]
SAMPLES = 5
SAMPLE_SIZE = (148, 148)
FILM_SIZE = (288, 384)
PICTURE_SIZE = (480, 800)
FILM_RATE = 8.0
FILM_BYTES = 300_000

HEAD = """# Gallery

Every primitive, motion and variant that ships with geoprior, drawn with the packaged config `lite`,
and the options that the packaged config `sighted` sets. The pictures and this page are made by

    GEOPRIOR_PLUGINS= python docs/make_gallery.py

and those of your own plug-ins too by `python docs/make_gallery.py FOLDER`. `geoprior view` draws any
episode in the same way, in shards or not:

    geoprior view lite:push-000004 --3d --orbit 360

In 3-D the floor is grey, the object blue, the marker green, the hand orange. The orange line is the way
of the hand, thick while the gripper is closed, with its shadow on the floor; small triads on it are the
hand's frame: right pink, up yellow, forward white. The frusta are the cameras, and the dashed line is
where the third-person one looks. What is faint was earlier.
"""
PRIMITIVES = """Random samples in 3-D; below each, what the hand and the third-person camera see of it in the
first frame of a pick."""
MOTIONS = "A contact sheet of both cameras, then the same episode in 3-D: the whole way, and moving."
VARIANTS = "What both cameras see of one pick as each variant leaves it."
CHOICES = """Options of `generate.scene` and of the motions that the paper's recipe leaves alone, drawn as
solids. In each row the objects are the same, the hand's view above the third-person one."""


def main() -> None:
    """Draw everything, then write the page."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else DOCS
    (folder / IMAGES).mkdir(parents=True, exist_ok=True)
    found = plugins()
    config = load_config(CONFIG, SETTINGS, found)
    for name in found.names("primitive"):
        save(folder / primitive_image(name), primitive_strip(config, Choice(name=name)))
    for name in found.names("motion"):
        draw_motion(config, found.resolve("motion", Choice(name=name)), folder)
    for name in found.names("variant"):
        save(folder / variant_image(name), variant_sheet(config, Choice(name=name)))
    for option in OPTIONS:
        save(folder / option_image(option), option_picture(option, found))
    (folder / "gallery.md").write_text(page(found), encoding="utf-8")
    size = sum(path.stat().st_size for path in (folder / IMAGES).iterdir())
    print(f"{folder / 'gallery.md'}: {size / 1e6:.2f} MB of pictures")


def primitive_strip(config: RunConfig, primitive: Choice) -> np.ndarray:
    """Some random samples of a primitive in 3-D, each above what both cameras see of it."""
    generate = config.generate.model_copy(update={"primitives": [primitive]})
    studio = Studio(generate, config.cameras, config.seed)
    return framed(beside([_sample(studio, index) for index in range(SAMPLES)], 12))


def _sample(studio: Studio, index: int) -> np.ndarray:
    motion = studio.config.motions[0]
    episode, take = studio.episode(motion, index), studio.stage(motion, index)
    world = world_of(episode.header, episode.pose, bodies_of(take))
    clouds = tuple(cloud for cloud in world.bodies.clouds if cloud.body in {"floor", "object"})
    scene = replace(world, bodies=replace(world.bodies, clouds=clouds), hands=(), cameras=(), hand_cube=0.0)
    views = [to_rgb(episode.images[camera.name][0]) for camera in episode.header.cameras]
    width = sum(view.shape[1] for view in views) + 4
    return below([space_view(scene, Angle(), size=(SAMPLE_SIZE[0], width)), beside(views)])


def draw_motion(config: RunConfig, motion: Choice, folder: Path) -> None:
    """Contact sheet, picture in 3-D and film of one episode of a motion."""
    studio = Studio(config.generate, config.cameras, config.seed)
    episode, take = studio.episode(motion, 0), studio.stage(motion, 0)
    world = world_of(episode.header, episode.pose, bodies_of(take))
    sheet, picture, film = (folder / image for image in motion_images(motion.name))
    save(sheet, episode_sheet(episode, cell=96))
    save(picture, space_picture(episode, world, Angle(), size=PICTURE_SIZE))
    frames = list(space_film(episode, world, Angle(), size=FILM_SIZE))
    for stride in range(2, len(frames)):
        write_film(film, frames[::-stride][::-1], FILM_RATE)  # the last step is among them
        if film.stat().st_size < FILM_BYTES:
            return


def variant_sheet(config: RunConfig, variant: Choice) -> np.ndarray:
    """Contact sheet of an episode as a variant leaves it."""
    generate = config.generate.model_copy(update={"variants": [variant]})
    return episode_sheet(
        Studio(generate, config.cameras, config.seed).episode(generate.motions[0], 0), cell=96
    )


def save(path: Path, picture: np.ndarray) -> None:
    """Write a PNG of at most 256 colours: these pictures have few."""
    reduced([picture])[0].save(path, optimize=True)


def page(found: Plugins) -> str:
    """The page, in Markdown."""
    return "\n".join([HEAD, *_sections(found)])


def _sections(found: Plugins) -> Iterator[str]:
    yield from _section(found, "primitive", "Primitives", PRIMITIVES, lambda name: [primitive_image(name)])
    yield from _section(found, "motion", "Motions", MOTIONS, motion_images)
    yield from _section(found, "variant", "Variants", VARIANTS, lambda name: [variant_image(name)])
    yield f"## Options\n\n{CHOICES}\n"
    for option in OPTIONS:
        link = f"![{option.name}]({option_image(option).as_posix()})"
        yield "\n\n".join([f"### {option.name}", option.text, link]) + "\n"


def _section(
    found: Plugins, kind: str, title: str, text: str, images: Callable[[str], Sequence[Path]]
) -> Iterator[str]:
    names = found.names(kind)
    if names:
        yield f"## {title}\n\n{text}\n"
    for name in names:
        links = [f"![{name}]({image.as_posix()})" for image in images(name)]
        yield "\n\n".join([f"### {name}", found.spec(kind, name).summary.capitalize() + ".", *links]) + "\n"


def primitive_image(name: str) -> Path:
    """Of a primitive, relative to the page."""
    return IMAGES / f"primitive-{name}.png"


def motion_images(name: str) -> Sequence[Path]:
    """Sheet, picture in 3-D and film of a motion, relative to the page."""
    return [IMAGES / f"motion-{name}{ending}" for ending in (".png", "-3d.png", "-3d.gif")]


def variant_image(name: str) -> Path:
    """Of a variant, relative to the page."""
    return IMAGES / f"variant-{name}.png"


def option_image(option: Option) -> Path:
    """Of an option, relative to the page."""
    return IMAGES / f"option-{option.name}.png"


if __name__ == "__main__":
    main()
