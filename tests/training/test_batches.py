import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from training_material import FakeStore, make_demonstration

from geoprior.errors import DataError
from geoprior.policies.normalise import Normaliser, normalise_images
from geoprior.shards.reader import EpisodeStore
from geoprior.sources.shards import ShardSource
from geoprior.training.config import TrainConfig
from geoprior.training.data import Batches, chunk_steps, features_of, statistics_of
from geoprior.training.frames import add_noise, shift_frames


def make_batches(store, seed=0, chunk=4, **options):
    source = ShardSource(store)
    config = TrainConfig(**{"batch_size": 7, "image_noise": 0.0, "prefetch": 0, **options})
    normaliser = Normaliser(statistics_of(source))
    return Batches(source, features_of(source, chunk), normaliser, config, seed), normaliser


def same(first, second):
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)


@given(length=st.integers(1, 20), chunk=st.integers(1, 12), skip=st.integers(1, 5), data=st.data())
def test_a_chunk_takes_every_skipth_action_and_marks_what_is_past_the_end(length, chunk, skip, data):
    times = data.draw(st.lists(st.integers(0, length - 1), min_size=1, max_size=4))
    found, valid = chunk_steps(np.array(times), np.array([length] * len(times)), chunk, skip)
    assert found.shape == (len(times), 1 + chunk)
    assert valid.shape == (len(times), chunk)
    assert found[:, 0].tolist() == times
    for row, time in enumerate(times):
        for i in range(chunk):
            assert valid[row, i] == (time + i * skip < length)
            assert found[row, 1 + i] == min(time + (i + 1) * skip - 1, length - 1)
    assert valid[:, 0].all()


@pytest.mark.parametrize("skip", [1, 2, 3])
def test_the_first_action_is_the_pose_at_the_policys_next_step(skip):
    """Whatever the data's rate: a prior at 30 steps a second and arms at 10 teach the same."""
    episode = make_demonstration(3, steps=12)
    batch = make_batches(FakeStore([episode]), skip=skip, batch_size=12)[0].batch(0)
    poses = np.concatenate([episode.pose, episode.action[-1:]])
    normaliser = Normaliser(statistics_of(ShardSource(FakeStore([episode]))))
    seen = normaliser.denormalise("pose", batch["pose"].numpy())
    first = normaliser.denormalise("action", batch["action"][:, 0].numpy())
    for pose, action in zip(seen, first, strict=True):
        time = int(np.abs(episode.pose - pose).sum(axis=1).argmin())
        np.testing.assert_allclose(action, poses[min(time + skip, 12)], atol=1e-6)


def test_early_time_steps_have_fewer_actions_past_the_end():
    """`early` reaches the batches: chunks near an episode's end are cut, and they become rare."""
    store = FakeStore([make_demonstration(number, steps=8) for number in range(40)])
    cut = {
        early: float((~make_batches(store, early=early, batch_size=400)[0].batch(0)["valid"]).float().mean())
        for early in (1.0, 4.0)
    }
    assert cut[4.0] < 0.5 * cut[1.0]


def test_a_batch_holds_what_the_episodes_hold(fake_store):
    batches, normaliser = make_batches(fake_store)
    batch = batches.batch(2)
    samples = batches._order.samples(14, 7)
    for row, (episode, time) in enumerate(samples):
        source = fake_store.episodes[episode]
        pose = normaliser.denormalise("pose", batch["pose"][row].numpy())
        np.testing.assert_allclose(pose, source.pose[time], atol=1e-6)
        action = normaliser.denormalise("action", batch["action"][row, 0].numpy())
        np.testing.assert_allclose(action, source.action[time], atol=1e-6)
        frames = np.stack([source.images[name][time] for name in fake_store.cameras])
        expected = normalise_images(torch.from_numpy(frames[..., None]))
        assert torch.equal(batch["images"][row], expected)


def test_a_batch_depends_on_seed_and_step_only(fake_store):
    batches, _ = make_batches(fake_store, image_noise=0.1, image_shift=3)
    third = batches.batch(3)
    batches.batch(1)
    again, _ = make_batches(fake_store, image_noise=0.1, image_shift=3)
    assert same(again.batch(3), third)
    other, _ = make_batches(fake_store, seed=1, image_noise=0.1, image_shift=3)
    assert not same(other.batch(3), third)


def test_numbers_count_on_from_epoch_to_epoch_within_a_batch_too(fake_store):
    """Five batches of seven samples are seven epochs of five episodes."""
    batches, _ = make_batches(fake_store)
    asked, read = [], batches._source.read
    batches._source.read = lambda numbers, steps: asked.extend(numbers.tolist()) or read(numbers, steps)
    for step in range(5):
        batches.batch(step)
    epochs = [sorted(asked[first : first + 5]) for first in range(0, 35, 5)]
    assert epochs == [list(range(first, first + 5)) for first in range(0, 35, 5)]


@pytest.mark.parametrize("workers", [0, 1, 2, 5])
@pytest.mark.parametrize("prefetch", [1, 3, 64])
def test_reading_ahead_changes_nothing(fake_store, prefetch, workers):
    alone, _ = make_batches(fake_store, image_noise=0.1)
    ahead, _ = make_batches(fake_store, image_noise=0.1, prefetch=prefetch, loader_workers=workers)
    found = list(ahead.stream(2, 9))
    assert len(found) == 7
    assert all(same(a, b) for a, b in zip(found, alone.stream(2, 9), strict=True))


@pytest.mark.parametrize("workers", [0, 1, 2])
def test_a_stream_that_goes_on_names_the_samples_that_the_whole_one_names(fake_store, workers):
    """Numbers and time steps as the source is asked for them, whatever was read ahead before."""

    def asked(first, last):
        batches, _ = make_batches(fake_store, prefetch=3, loader_workers=workers)
        rows, read = {}, batches._source.read

        def note(numbers, steps):
            moments = read(numbers, steps)
            rows[moments.pose.tobytes()] = (numbers.tolist(), steps[:, 0].tolist())
            return moments

        batches._source.read = note
        normalised = [batch["pose"].numpy().tobytes() for batch in batches.stream(first, last)]
        return normalised, sorted(rows.values())

    whole, ids = asked(0, 9)
    for cut in (1, 4, 8):
        head, head_ids = asked(0, cut)
        tail, tail_ids = asked(cut, 9)
        assert head + tail == whole
        assert sorted(head_ids + tail_ids) == ids


def test_a_fault_while_reading_ahead_is_raised(fake_store):
    batches, _ = make_batches(fake_store, prefetch=2)

    def broken(i, camera, steps):
        raise DataError(f"episode {i} is damaged")

    fake_store.frames = broken
    with pytest.raises(DataError, match="is damaged"):
        list(batches.stream(0, 4))


def test_shards_give_what_memory_gives(fake_store, demos):
    from_disk, _ = make_batches(EpisodeStore(demos), image_noise=0.05)
    from_memory, _ = make_batches(fake_store, image_noise=0.05)
    assert same(from_disk.batch(1), from_memory.batch(1))


def test_binary_and_colour_cameras_share_a_batch():
    colour = [make_demonstration(index, channels=3) for index in range(3)]
    mixed = [make_demonstration(index, channels=3) for index in range(3)]
    for episode in mixed:
        episode.images["hand"] = episode.images["hand"][..., 0]
    batches = [make_batches(FakeStore(episodes))[0].batch(0) for episodes in (colour, mixed)]
    assert same(*batches)


def test_noise_is_normal_with_the_standard_deviation_asked_for():
    frames = np.full((50, 2, 32, 32, 3), 128, np.uint8)
    noise = (add_noise(frames, 0.08, np.random.default_rng(0)).numpy().ravel() - 128) / 255
    assert noise.std() == pytest.approx(0.08, rel=0.01)
    assert abs(noise.mean()) < 0.0005
    for sigmas, share in ((1.0, 0.6827), (2.0, 0.9545)):
        assert np.mean(abs(noise) < 0.08 * sigmas) == pytest.approx(share, abs=0.006)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.01


def test_no_noise_leaves_the_bytes():
    frames = np.arange(24, dtype=np.uint8).reshape(1, 2, 2, 2, 3)
    clean = add_noise(frames, 0.0, np.random.default_rng(0))
    assert clean.dtype == torch.uint8
    assert np.array_equal(clean.numpy(), frames)


def test_shifts_move_each_frame_by_itself_and_repeat_the_edge():
    rng = np.random.default_rng(0)
    frames = rng.integers(256, size=(6, 2, 9, 11, 3), dtype=np.uint8)
    shifted = shift_frames(frames, 2, np.random.default_rng(1))
    padded = np.pad(frames, ((0, 0), (0, 0), (2, 2), (2, 2), (0, 0)), mode="edge")
    places = set()
    for b in range(6):
        for c in range(2):
            found = [
                (row, column)
                for row in range(5)
                for column in range(5)
                if np.array_equal(padded[b, c, row : row + 9, column : column + 11], shifted[b, c])
            ]
            assert len(found) == 1
            places.update(found)
    assert len(places) > 3


def test_statistics_are_those_of_the_raw_rows(fake_store):
    statistics = statistics_of(ShardSource(fake_store))
    rows = np.concatenate([episode.action for episode in fake_store.episodes]).astype(np.float64)
    np.testing.assert_allclose(statistics["action"].mean, rows.mean(0), atol=1e-12)
    assert statistics["pose"].count == len(rows)


def test_a_stream_without_an_end_can_be_begun(fake_store):
    """Nothing is laid out in advance: a benchmark asks for more steps than memory has room for."""
    for prefetch in (0, 2):
        batches, _ = make_batches(fake_store, prefetch=prefetch)
        stream = batches.stream(0, 10**15)
        assert same(next(stream), batches.batch(0))
        stream.close()
