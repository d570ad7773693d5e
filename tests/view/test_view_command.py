import cv2
import pytest
from click.testing import CliRunner
from PIL import Image, ImageSequence

from geoprior.cli import cli
from geoprior.errors import ConfigError, DataError
from geoprior.shards.golden import FILE, write_golden
from geoprior.view.command import NO_FILM, Look, draw, preview
from geoprior.view.orbit import Angle
from geoprior.view.subject import stored_subject


@pytest.fixture
def folder(tmp_path):
    write_golden(tmp_path / "run" / "shards")
    return tmp_path / "run" / "shards"


def frames_of(path):
    """Number of frames and their size (columns, rows)."""
    if path.suffix == ".gif":
        with Image.open(path) as image:
            return sum(1 for _ in ImageSequence.Iterator(image)), image.size
    film = cv2.VideoCapture(str(path))
    count = 0
    while (taken := film.read())[0]:
        count, size = count + 1, (taken[1].shape[1], taken[1].shape[0])
    return count, size


@pytest.mark.parametrize(
    ("episode", "key"), [("0", "pick-000000"), ("1", "push-000001"), ("push-000001", "push-000001")]
)
@pytest.mark.parametrize("source", ["", FILE])
def test_an_episode_becomes_a_sheet_and_a_film(folder, tmp_path, episode, key, source):
    files = draw(stored_subject(folder / source, episode), tmp_path / "out", Look())
    assert files == [tmp_path / "out" / f"{key}.png", tmp_path / "out" / f"{key}.webm"]
    assert sorted((tmp_path / "out").iterdir()) == files
    with Image.open(files[0]) as image:
        assert image.format == "PNG"
    assert files[1].read_bytes()[:4] == b"\x1a\x45\xdf\xa3"
    assert b"webm" in files[1].read_bytes()[:64]


@pytest.mark.parametrize("film", ["webm", "mp4", "gif"])
def test_films_of_every_kind_have_a_frame_for_each_step_in_3d_too(push, tmp_path, film):
    files = draw(push, tmp_path, Look(film=film, angle=Angle(), orbit=45.0))
    names = [f"push-000001{ending}" for ending in (".png", "-3d.png", f".{film}", f"-3d.{film}")]
    assert [path.name for path in files] == names
    for path in files[2:]:
        count, (columns, rows) = frames_of(path)
        assert count == 8
        assert columns > 60
        assert rows > 60
    assert frames_of(files[3])[1] >= (640, 480)


def test_angle_orbit_and_width_reach_the_pictures(push, tmp_path):
    looks = {
        "usual": Look(film="mp4", angle=Angle()),
        "angle": Look(film="mp4", angle=Angle(10.0, 10.0)),
        "orbit": Look(film="mp4", angle=Angle(), orbit=90.0),
        "wide": Look(film="mp4", angle=Angle(), wide=True),
    }
    sheet, picture, film, film_in_3d = range(4)
    made = {
        name: [path.read_bytes() for path in draw(push, tmp_path / name, look)]
        for name, look in looks.items()
    }
    for number, same in ((sheet, 1), (film, 1), (picture, 3), (film_in_3d, 4)):
        assert len({files[number] for files in made.values()}) == same
    assert made["orbit"][picture] == made["usual"][picture]


def test_no_film_is_made_where_none_is_wanted(push, tmp_path):
    files = draw(push, tmp_path, Look(film=NO_FILM, angle=Angle()))
    assert [path.name for path in files] == ["push-000001.png", "push-000001-3d.png"]
    assert sorted(tmp_path.iterdir()) == sorted(files)


def test_an_unknown_kind_of_film_shows_the_choices(push, tmp_path):
    with pytest.raises(ConfigError, match=r"'\.avi' are unknown") as caught:
        draw(push, tmp_path, Look(film="avi"))
    assert ".webm" in caught.value.hint


def test_what_cannot_be_shown_is_named(folder):
    with pytest.raises(DataError, match="no episode 'pick-000001'") as caught:
        stored_subject(folder, "pick-000001")
    assert "did you mean" in caught.value.hint
    with pytest.raises(DataError, match="no such file") as caught:
        stored_subject(folder.parent, "0")
    assert str(folder) in caught.value.hint


@pytest.mark.parametrize(
    ("asked", "look"),
    [
        ({}, Look("webm", None, 0.0, wide=False)),
        ({"space": True}, Look("webm", Angle(35.0, 30.0), 0.0, wide=False)),
        ({"azimuth": 0.0}, Look("webm", Angle(0.0, 30.0), 0.0, wide=False)),
        ({"elevation": -90.0, "film": "gif"}, Look("gif", Angle(35.0, -90.0), 0.0, wide=False)),
        ({"orbit": 360.0}, Look("webm", Angle(35.0, 30.0), 360.0, wide=False)),
        ({"wide": True}, Look("webm", Angle(35.0, 30.0), 0.0, wide=True)),
    ],
)
def test_what_is_said_of_the_view_in_3d_asks_for_it(asked, look):
    assert Look.of(**asked) == look


@pytest.mark.parametrize(
    ("option", "value"),
    [("azimuth", "nan"), ("azimuth", "inf"), ("elevation", "90.5"), ("elevation", "-91"), ("orbit", "1e9")],
)
def test_an_angle_out_of_range_is_refused_by_name(option, value):
    with pytest.raises(ConfigError, match=f"--{option} .*: out of range") as caught:
        Look.of(**{option: float(value)})
    assert "degrees from" in caught.value.hint


def run(*arguments):
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def test_the_command_prints_the_files_and_teaches_its_options(folder, tmp_path):
    done = run("view", f"{folder}:1", "--out", tmp_path / "out", "--3d", "--film", "gif")
    assert done.exit_code == 0, done.output
    printed = done.stdout.split()
    assert sorted(printed) == sorted(str(path) for path in (tmp_path / "out").iterdir())
    text = run("view", "--help").stdout
    for word in (
        "quickstart:push-000004 --3d --orbit 360",
        "--azimuth -90 --elevation 10 --film gif",
        "--set",
    ):
        assert word in text


def test_the_command_refuses_an_unknown_kind_of_film_by_name(folder):
    done = run("view", folder, "--film", "avi")
    assert done.exit_code == 2
    assert "'avi'" in done.output
    for kind in ("webm", "mp4", "gif", NO_FILM):
        assert kind in done.output


def test_a_data_set_of_binary_and_rgb_frames_is_previewed(folder, tmp_path):
    done = run(
        "shards",
        "preview",
        folder,
        "--out",
        tmp_path / "deeper" / "sheet.png",
        "--rows",
        "2",
        "--columns",
        "2",
    )
    assert done.exit_code == 0, done.output
    assert done.stdout.split() == [str(tmp_path / "deeper" / "sheet.png")]
    small = preview(folder, tmp_path / "small.png", rows=1, columns=1)
    with Image.open(tmp_path / "deeper" / "sheet.png") as sheet, Image.open(small) as one:
        assert sheet.format == "PNG"
        assert sheet.height > one.height
        assert sheet.width > one.width


@pytest.mark.parametrize(
    ("source", "name"), [("", "shards.png"), (FILE, "golden-000000.png"), (".", "shards.png")]
)
def test_a_preview_takes_its_name_from_the_data_set(folder, tmp_path, monkeypatch, source, name):
    (tmp_path / "desk").mkdir()
    monkeypatch.chdir(tmp_path / "desk")
    assert run("shards", "preview", folder / source).stdout.split() == [name]
    assert [path.name for path in (tmp_path / "desk").iterdir()] == [name]


def test_a_preview_of_nothing_is_refused(tmp_path):
    with pytest.raises(DataError, match="no such file"):
        preview(tmp_path, tmp_path / "sheet.png", 3, 3)
    assert list(tmp_path.iterdir()) == []
