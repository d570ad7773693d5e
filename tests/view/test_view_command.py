from pathlib import Path

import pytest
from PIL import Image

from geoprior.errors import DataError
from geoprior.shards.golden import FILE, write_golden
from geoprior.view.command import parse_episode, view, view_episode


@pytest.fixture
def folder(tmp_path):
    write_golden(tmp_path / "run" / "shards")
    return tmp_path / "run" / "shards"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("run/shards", ("run/shards", "0")),
        ("run/shards:pick-000003", ("run/shards", "pick-000003")),
        ("run/shards:3", ("run/shards", "3")),
        ("run/a.tar:pick-000003", ("run/a.tar", "pick-000003")),
        ("C:run:pick", ("C:run", "pick")),
        (":pick", (":pick", "0")),
    ],
)
def test_an_episode_is_a_path_and_perhaps_a_key(text, expected):
    assert parse_episode(text) == (Path(expected[0]), expected[1])


def test_a_path_with_a_colon_that_exists_is_taken_whole(tmp_path):
    (tmp_path / "a:b").mkdir()
    assert parse_episode(f"{tmp_path}/a:b") == (tmp_path / "a:b", "0")
    assert parse_episode(f"{tmp_path}/a:b:key") == (tmp_path / "a:b", "key")


@pytest.mark.parametrize(
    ("episode", "key"), [("", "pick-000000"), (":1", "push-000001"), (":push-000001", "push-000001")]
)
@pytest.mark.parametrize("source", ["", f"/{FILE}"])
def test_an_episode_becomes_a_sheet_and_a_film(folder, tmp_path, episode, key, source):
    files = view_episode(f"{folder}{source}{episode}", tmp_path / "out")
    assert files == [tmp_path / "out" / f"{key}.png", tmp_path / "out" / f"{key}.webm"]
    assert sorted((tmp_path / "out").iterdir()) == files
    with Image.open(files[0]) as image:
        assert image.format == "PNG"
    assert files[1].read_bytes()[:4] == b"\x1a\x45\xdf\xa3"
    assert b"webm" in files[1].read_bytes()[:64]


def test_what_cannot_be_shown_is_named_and_nothing_is_written(folder, tmp_path):
    with pytest.raises(DataError, match="no episode 'pick-000001'") as caught:
        view(folder, "pick-000001", tmp_path / "out")
    assert "did you mean" in caught.value.hint
    with pytest.raises(DataError, match="no such file") as caught:
        view(folder.parent, 0, tmp_path / "out")
    assert str(folder) in caught.value.hint
    assert not (tmp_path / "out").exists()
