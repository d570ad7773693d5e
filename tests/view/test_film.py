import cv2
import numpy as np
import pytest
from PIL import Image, ImageSequence

from geoprior.errors import ConfigError, DataError
from geoprior.shards.golden import golden_episodes
from geoprior.view.canvas import to_rgb
from geoprior.view.film import episode_film, write_film

SUFFIXES = (".webm", ".mp4", ".gif", ".png")


def frames(count=12, height=48, width=64):
    """A red square that crosses a dark floor."""
    film = np.full((count, height, width, 3), 30, np.uint8)
    for step in range(count):
        film[step, 16:32, 4 * step : 4 * step + 16] = (220, 40, 40)
    return film


def read_film(path):
    """(frames, fps): through OpenCV for films, through Pillow for pictures."""
    if path.suffix in (".gif", ".png"):
        with Image.open(path) as image:
            shown = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(image)]
            return np.stack(shown), 1000.0 / image.info["duration"]
    film = cv2.VideoCapture(str(path))
    shown = []
    while (taken := film.read())[0]:
        shown.append(taken[1][..., ::-1])
    return np.stack(shown), film.get(cv2.CAP_PROP_FPS)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_film_shows_its_frames_in_order_colour_and_time(tmp_path, suffix):
    write_film(tmp_path / f"film{suffix}", frames(), fps=10.0)
    shown, fps = read_film(tmp_path / f"film{suffix}")
    assert shown.shape == frames().shape
    assert fps == pytest.approx(10.0)
    difference = np.abs(shown.astype(int) - frames())
    tolerance = 0 if suffix == ".png" else 8
    assert difference.mean(axis=(1, 2, 3)).max() <= tolerance
    for step in range(12):
        np.testing.assert_allclose(shown[step, 24, 4 * step + 8], (220, 40, 40), atol=25)
    assert [path.name for path in tmp_path.iterdir()] == [f"film{suffix}"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_same_frames_give_the_same_bytes(tmp_path, suffix):
    for name in ("a", "b"):
        write_film(tmp_path / f"{name}{suffix}", iter(frames()), fps=10.0)
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_odd_sizes_single_frames_and_scales(tmp_path, suffix):
    path = tmp_path / f"film{suffix}"
    write_film(path, frames(1, 35, 51), fps=10.0, scale=3)
    if suffix in (".gif", ".png"):
        with Image.open(path) as image:
            assert image.size == (153, 105)
    else:
        shown, _ = read_film(path)
        assert shown.shape == (1, 106, 154, 3)


def test_what_rests_in_a_gif_does_not_flicker_and_common_colours_are_exact(tmp_path):
    rng = np.random.default_rng(0)
    film = frames(count=12, height=96, width=128)
    film[:, 60:, :] = rng.integers(0, 256, size=(36, 128, 3))  # thousands of colours at rest
    write_film(tmp_path / "film.gif", film, fps=10.0)
    shown, _ = read_film(tmp_path / "film.gif")
    for step in range(12):
        np.testing.assert_array_equal(shown[step, 60:], shown[0, 60:])
        np.testing.assert_array_equal(shown[step, :60], film[step, :60])
    assert np.abs(shown[0, 60:].astype(int) - film[0, 60:]).mean() < 25


def test_nothing_is_said_on_stderr_and_stderr_still_works(tmp_path, capfd):
    write_film(tmp_path / "film.webm", frames(), fps=10.0)
    import os

    os.write(2, b"still here\n")
    assert capfd.readouterr().err == "still here\n"


def test_an_unknown_suffix_shows_the_choices(tmp_path):
    with pytest.raises(ConfigError, match=r"film\.avi: films of the kind '\.avi'") as caught:
        write_film(tmp_path / "film.avi", frames(), fps=10.0)
    assert caught.value.hint == "choices: .webm, .mp4, .gif, .png"


def test_no_frames_or_frames_of_two_sizes_are_refused_and_nothing_is_left(tmp_path):
    with pytest.raises(ValueError, match="at least one frame"):
        write_film(tmp_path / "film.webm", [], fps=10.0)
    for suffix in SUFFIXES:
        with pytest.raises(ValueError, match="all of one size"):
            write_film(tmp_path / f"film{suffix}", [frames()[0], frames(1, 20, 20)[0]], fps=10.0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_folder_that_cannot_be_written_is_named(tmp_path, suffix):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(DataError, match="cannot be written"):
        write_film(tmp_path / "file" / f"film{suffix}", frames(), fps=10.0)


def test_an_episodes_film_shows_every_camera_at_every_step():
    episode = next(golden_episodes())
    film = list(episode_film(episode, cell=16))
    assert len(film) == episode.header.steps
    assert len({frame.shape for frame in film}) == 1
    for step, frame in enumerate(film):
        left = 8
        for camera in ("hand", "third"):
            np.testing.assert_array_equal(frame[8:24, left : left + 16], to_rgb(episode.images[camera][step]))
            left += 20
