"""Make the pictures of the README and the docs from a finished run.

python docs/make_images.py runs/quickstart
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from geoprior.shards.reader import EpisodeStore
from geoprior.view.canvas import below, framed
from geoprior.view.sheet import store_sheet, write_sheet

IMAGES = Path(__file__).parent / "images"


def overview(run: Path) -> np.ndarray:
    """Synthetic episodes above the demonstrations that they prepare for."""
    synthetic = store_sheet(EpisodeStore(run / "shards" / "synthetic"), rows=3, columns=5)
    demos = store_sheet(EpisodeStore(run / "shards" / "demos"), rows=1, columns=5)
    return framed(below([synthetic, demos]))


def main() -> None:
    """Write every picture."""
    IMAGES.mkdir(exist_ok=True)
    path = IMAGES / "overview.png"
    write_sheet(path, overview(Path(sys.argv[1])))
    print(path)


if __name__ == "__main__":
    main()
