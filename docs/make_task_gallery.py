"""Draw every robot, task and look, and write those parts of docs/tasks.md that the code can tell.

python docs/make_task_gallery.py                         pictures and page, some minutes
python docs/make_task_gallery.py 'task-pick-*' 'look-*'  those pictures, and the page
python docs/make_task_gallery.py --page                  the page alone
python docs/make_task_gallery.py --check                 ends with 1 if the page is not what the code says

The page is prose with parts between markers; only these are written. What ships with geoprior is shown.
"""

from __future__ import annotations

import sys
from fnmatch import fnmatch

from PIL import Image
from task_page import IMAGES, PAGE, written
from task_pictures import pictures

from geoprior.view.canvas import framed

FOLDER = PAGE.parent / IMAGES


def main() -> None:
    """Compare the page, or write it and draw what is asked for."""
    arguments, old = sys.argv[1:], PAGE.read_text(encoding="utf-8")
    new = written(old)
    if arguments == ["--check"]:
        sys.exit(0 if old == new else f"{PAGE}: run docs/make_task_gallery.py --page")
    PAGE.write_text(new, encoding="utf-8")
    if arguments != ["--page"]:
        draw(arguments or ["*"])


def draw(patterns: list[str]) -> None:
    """Draw those pictures whose names match any of the patterns."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, make in pictures().items():
        if any(fnmatch(name, pattern) for pattern in patterns):
            # In all their colours: a palette for the whole picture would repaint small things.
            Image.fromarray(framed(make())).save(FOLDER / f"{name}.png", optimize=True)
            print(name, flush=True)
    size = sum(path.stat().st_size for path in FOLDER.iterdir())
    print(f"{FOLDER}: {size / 1e6:.2f} MB of pictures")


if __name__ == "__main__":
    main()
