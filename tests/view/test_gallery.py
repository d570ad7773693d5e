"""docs/gallery.md shows all that ships; `GEOPRIOR_PLUGINS= python docs/make_gallery.py` makes it again."""

import re
from pathlib import Path

import pytest
from PIL import Image

from geoprior.hooks.manager import GROUP, plugins

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "gallery.md").read_text(encoding="utf-8")
LINKS = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", PAGE)


def built_in(kind):
    found = plugins()
    return [name for name in found.names(kind) if found.plugin_of(kind, name).package == GROUP]


def section(name):
    """What stands under a name's heading."""
    found = re.search(rf"^### {re.escape(name)}\n(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert found, f"docs/gallery.md does not show {name!r}"
    return found[1]


@pytest.mark.parametrize("kind", ["primitive", "motion", "variant"])
def test_the_page_shows_everything_that_is_built_in(kind):
    for name in built_in(kind):
        links = re.findall(r"\(([^)]+)\)", section(name))
        assert any(Path(link).stem.startswith(f"{kind}-{name}") for link in links), name


def test_every_motion_has_a_sheet_a_picture_in_3d_and_a_small_film():
    for name in built_in("motion"):
        film = DOCS / "images" / "gallery" / f"motion-{name}-3d.gif"
        for path in (film, film.with_suffix(".png"), film.with_name(f"motion-{name}.png")):
            assert path.relative_to(DOCS).as_posix() in section(name)
        with Image.open(film) as image:
            assert image.is_animated
        assert film.stat().st_size < 300_000


def test_every_picture_that_the_page_links_is_there_and_no_other():
    folder = DOCS / "images" / "gallery"
    assert sorted(LINKS) == sorted(path.relative_to(DOCS).as_posix() for path in folder.iterdir())
    assert sum(path.stat().st_size for path in folder.iterdir()) < 2_500_000
    for link in LINKS:
        with Image.open(DOCS / link) as image:
            image.verify()
