"""Make the pictures of the README and the docs.

python docs/make_images.py                    those that need no run
python docs/make_images.py runs/quickstart    those of a finished run too
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from geoprior.config import load_config
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.shards.reader import EpisodeStore
from geoprior.synthesis.studio import Studio
from geoprior.view.canvas import GAP, below, beside, framed, to_rgb
from geoprior.view.sheet import evenly_spaced, store_sheet, write_sheet

IMAGES = Path(__file__).parent / "images"
RENDERERS = ("points", "solids")
SETTINGS = ["seed=100", "cameras.height=96", "cameras.width=96"]


def overview(run: Path) -> np.ndarray:
    """Synthetic episodes above the demonstrations that they prepare for."""
    synthetic = store_sheet(EpisodeStore(run / "shards" / "synthetic"), rows=3, columns=5)
    demos = store_sheet(EpisodeStore(run / "shards" / "demos"), rows=1, columns=5)
    return framed(below([synthetic, demos]))


def solids(columns: int = 4) -> np.ndarray:
    """One episode of each motion as the built-in renderers draw it, one above the other."""
    return framed(
        below([below(rows, GAP) for rows in zip(*map(_rows, RENDERERS, [columns] * 2), strict=True)], 16)
    )


def _rows(renderer: str, columns: int) -> list[np.ndarray]:
    config = load_config("lite", [*SETTINGS, f"generate.renderer={renderer}"], plugins())
    studio = Studio(config.generate, config.cameras, config.seed)
    rows = []
    for number, motion in enumerate(config.generate.motions):
        episode = studio.episode(Choice(name=motion.name), number + 1)
        steps = evenly_spaced(episode.header.steps, columns)
        views = [beside([to_rgb(images[step]) for step in steps]) for images in episode.images.values()]
        rows.append(beside(views, 4 * GAP))
    return rows


def main() -> None:
    """Write every picture."""
    IMAGES.mkdir(exist_ok=True)
    pictures = {"solids": solids()}
    if len(sys.argv) > 1:
        pictures["overview"] = overview(Path(sys.argv[1]))
    for name, picture in pictures.items():
        path = IMAGES / f"{name}.png"
        write_sheet(path, picture)
        print(path)


if __name__ == "__main__":
    main()
