import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from geoprior.episode import Episode
from geoprior.shards.golden import golden_episodes
from geoprior.shards.manifest import write_manifest
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.writer import write_shard
from geoprior.view import canvas
from geoprior.view.captions import episode_caption, line_of, phase_of, step_caption
from geoprior.view.sheet import episode_sheet, evenly_spaced, representative, store_sheet, write_sheet


@pytest.fixture(scope="module")
def episode():
    return next(golden_episodes())


def contains(sheet, part):
    """Whether a part stands somewhere in a sheet, pixel for pixel."""
    windows = np.lib.stride_tricks.sliding_window_view(sheet, part.shape)[:, :, 0]
    return bool((windows == part).all(axis=(2, 3, 4)).any())


def test_an_episodes_sheet_shows_every_camera_and_step_in_whole_pixels(episode):
    sheet = episode_sheet(episode, columns=3, cell=32)
    assert sheet.dtype == np.uint8
    for name, images in episode.images.items():
        for step in range(3):
            frame = canvas.enlarge(canvas.to_rgb(images[step]), 2)
            assert contains(sheet, frame), (name, step)


def test_a_sheet_shows_no_step_that_was_not_asked_for(episode):
    sheet = episode_sheet(episode, columns=2, cell=16)
    shown = [contains(sheet, canvas.to_rgb(episode.images["third"][step])) for step in range(3)]
    assert shown == [True, False, True]


def test_a_written_sheet_is_a_png_of_the_same_pixels(tmp_path, episode):
    sheet = episode_sheet(episode)
    write_sheet(tmp_path / "deeper" / "sheet.png", sheet)
    with Image.open(tmp_path / "deeper" / "sheet.png") as image:
        np.testing.assert_array_equal(np.asarray(image), sheet)


def test_large_frames_shrink_and_small_ones_grow_by_whole_pixels():
    assert canvas.fit(np.zeros((480, 640, 3), np.uint8), 96).shape == (96, 128, 3)
    assert canvas.fit(np.zeros((96, 96, 3), np.uint8), 96).shape == (96, 96, 3)
    assert canvas.fit(np.zeros((40, 30, 3), np.uint8), 96).shape == (80, 60, 3)


@given(st.integers(1, 500), st.integers(1, 40))
def test_steps_are_spread_evenly_from_the_first_to_the_last(count, most):
    steps = evenly_spaced(count, most)
    assert len(steps) == min(count, most)
    assert steps == sorted(set(steps))
    assert steps[0] == 0
    if most > 1:
        assert steps[-1] == count - 1
        gaps = np.diff(steps)
        assert gaps.size == 0 or gaps.max() - gaps.min() <= 1


@pytest.fixture
def store(tmp_path, episode):
    motions = ["push"] * 2 + ["pick"] * 7 + ["place"] * 4
    episodes = [
        Episode(
            episode.header.model_copy(update={"key": f"{motion}-{i}", "motion": motion}),
            episode.pose,
            episode.action,
            episode.images,
        )
        for i, motion in enumerate(motions)
    ]
    write_manifest(tmp_path / "data", [write_shard(tmp_path / "data" / "a.tar", episodes)])
    return EpisodeStore(tmp_path / "data")


def test_motions_take_turns_on_a_data_sets_sheet(store):
    motions = [store.header(i).motion for i in representative(store, 6)]
    assert motions == ["pick", "place", "push"] * 2
    assert sorted(representative(store, 100)) == list(range(13))
    assert len(representative(store, 7)) == len(set(representative(store, 7))) == 7
    assert len(representative(store, 1)) == 1


def test_a_data_sets_sheet_has_a_row_for_each_episode(store):
    heights = [store_sheet(store, rows=rows, columns=2, cell=32).shape[0] for rows in (1, 2, 3)]
    row = heights[1] - heights[0]
    assert row == heights[2] - heights[1] > 32
    sheet = store_sheet(store, rows=1, columns=2, cell=16)
    for camera in store.cameras:
        for frame in store.frames(representative(store, 1)[0], camera, [0, 2]):
            assert contains(sheet, canvas.to_rgb(frame))


def test_captions_tell_key_step_time_phase_and_gripper(episode):
    assert episode_caption(episode.header) == "pick-000000  ·  pick a box  ·  synthetic  ·  3 steps at 10 Hz"
    assert step_caption(episode.header, episode.pose, 0) == ("0  ·  0.0 s", "", "open")
    assert step_caption(episode.header, episode.pose, 2) == ("2  ·  0.2 s", "", "closed")
    header = episode.header.model_copy(update={"details": {"phases": [["approach", 2], ["grasp", 1]]}})
    assert [phase_of(header, step) for step in range(3)] == ["approach", "approach", "grasp"]
    assert step_caption(header, episode.pose, 2)[1:] == ("grasp", "closed")
    assert line_of(["0.2 s", "", "closed"]) == "0.2 s  ·  closed"


def test_a_caption_names_the_hands_that_have_names_of_their_own():
    episode = next(golden_episodes())
    header = episode.header.model_copy(update={"hands": ["left", "right"]})
    pose = np.hstack([episode.pose, episode.pose[::-1]])
    assert step_caption(header, pose, 0)[2] == "left open  right closed"


@pytest.mark.parametrize(
    "phases", [None, "approach", [], [["approach"]], [[1, 2]], [["approach", "2"]], [["a", 1]]]
)
def test_phases_of_another_form_are_left_out(episode, phases):
    header = episode.header.model_copy(update={"details": {"phases": phases}})
    assert phase_of(header, 2) == ""


def test_a_caption_fits_its_width():
    bar = canvas.caption(["W" * 200, "short"], 50)
    assert bar.shape[1:] == (50, 3)
    assert (bar[:, -2:] == canvas.BACKGROUND).all()
    assert (bar != canvas.BACKGROUND).any()
