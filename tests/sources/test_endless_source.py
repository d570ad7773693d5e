"""Fresh episodes: those of the shards first, then others, and the same however they are read."""

import numpy as np
import pytest
from source_material import (
    CAMERAS,
    GENERATE,
    SEED,
    SLOTS,
    make_batches,
    read,
    same_batches,
    same_moments,
    write_shards,
)

from geoprior import MotionSpec, hookimpl
from geoprior.errors import ConfigError, PluginError
from geoprior.hooks.manager import plugins
from geoprior.options import Choice, Options
from geoprior.sources.source import targets_of
from geoprior.synthesis.studio import synthesise
from geoprior.training.data import features_of, statistics_of
from geoprior.training.order import steps_until


def epochs_as_steps(epochs, batch_size=5):
    return range(steps_until(epochs, SLOTS, batch_size))


@pytest.mark.parametrize("variants", [[], ["no-hand-cube"]])
def test_what_is_kept_to_the_end_is_what_the_shards_hold(source_of, tmp_path, variants):
    """Every bit of every batch, and the statistics behind it."""
    config = GENERATE.model_copy(update={"variants": [Choice(name=name) for name in variants]})
    recorded = source_of("shards", write_shards(tmp_path / "data", config))
    endless = source_of("endless", config=config, keep=4, workers=0)
    assert statistics_of(endless) == statistics_of(recorded)
    assert features_of(endless, 4) == features_of(recorded, 4)
    assert (endless.fps, len(endless)) == (recorded.fps, len(recorded))
    one, other = make_batches(endless), make_batches(recorded)
    for step in epochs_as_steps(4):
        assert same_batches(one.batch(step), other.batch(step)), step
    later = len(epochs_as_steps(8)) - 1
    assert not same_batches(one.batch(later), other.batch(later))


@pytest.mark.parametrize("workers", [0, 2])
def test_targets_come_from_shards_and_endless_alike_and_only_where_they_are_wanted(
    source_of, tmp_path, workers
):
    config = GENERATE.model_copy(update={"targets": True})
    recorded = source_of("shards", write_shards(tmp_path / "data", config))
    endless = source_of("endless", config=config, keep=4, workers=workers)
    names = targets_of(recorded)
    assert targets_of(endless) == names
    numbers, times = list(range(SLOTS)), [0, 3, 9, 5, 16, 1]
    one, other = (read(source, numbers, times) for source in (endless, recorded))
    assert same_moments(one, other)
    assert one.targets.shape == (SLOTS, len(names))
    without = source_of("endless", keep=4, workers=0)
    assert targets_of(without) == ()
    assert read(without, numbers, times).targets is None


def test_fresh_episodes_are_those_of_the_next_numbers(source_of):
    """With ``keep`` 1 every epoch brings the episodes that a larger data set would hold there."""
    source = source_of("endless", keep=1, workers=0)
    for epoch, slot in [(0, 5), (1, 0), (1, 3), (7, 4)]:
        index, turn = divmod(epoch * SLOTS + slot, 2)
        episode = synthesise(GENERATE, CAMERAS, SEED, GENERATE.motions[turn], index)
        moments = read(source, [epoch * SLOTS + slot], [6])
        assert np.array_equal(moments.pose[0], episode.pose[6])
        assert np.array_equal(moments.action[0], episode.action[6:9])
        for camera, frames in episode.images.items():
            assert np.array_equal(moments.frames[camera][0], frames[6])


def test_episodes_of_several_lengths_keep_their_slots_length(source_of, tmp_path):
    """Whatever stands in a slot later is as long as what stood there first, and the first are the shards'."""
    config = GENERATE.model_copy(update={"seconds": (2.0, 4.0)})
    recorded = source_of("shards", write_shards(tmp_path / "data", config))
    endless = source_of("endless", config=config, keep=1, workers=0)
    lengths = [len(pose) for pose in endless.poses]
    assert lengths == [len(pose) for pose in recorded.poses]
    assert len(set(lengths)) > 2
    assert 20 <= min(lengths) <= max(lengths) <= 40
    for slot, length in enumerate(lengths):
        for epoch in range(4):
            read(endless, [epoch * SLOTS + slot], [length - 3])
    with pytest.raises(IndexError):
        read(endless, [3 * SLOTS + int(np.argmin(lengths))], [min(lengths)])


def test_the_lengths_go_by_the_sources_own_number_of_episodes(source_of):
    config = GENERATE.model_copy(update={"seconds": (2.0, 4.0)})
    source = source_of("endless", config=config, keep=1, workers=0, episodes=5)
    lengths = [len(pose) for pose in source.poses]
    assert len(lengths) == 10
    for slot, length in enumerate(lengths):
        read(source, [len(source) + slot], [length - 3])


@pytest.mark.parametrize("cache_bytes", [0, 200_000])
def test_what_a_number_stands_for_does_not_depend_on_what_is_kept_or_was_read(source_of, cache_bytes):
    numbers = [SLOTS * epoch + slot for epoch in range(6) for slot in range(SLOTS)]
    times = [number % 17 for number in numbers]
    whole = read(source_of("endless", keep=2, workers=0), numbers, times)
    source = source_of("endless", keep=2, workers=0, cache_bytes=cache_bytes)
    for row in reversed(range(len(numbers))):
        alone = read(source, numbers[row : row + 1], times[row : row + 1])
        assert np.array_equal(alone.pose[0], whole.pose[row])
        assert np.array_equal(alone.action[0], whole.action[row])
        for camera, frames in alone.frames.items():
            assert np.array_equal(frames[0], whole.frames[camera][row])


@pytest.mark.parametrize(
    ("cache_bytes", "stagings"), [(2**24, 6 * SLOTS // 3), (0, 9 * SLOTS), (60_000, None)]
)
def test_a_kept_episode_is_staged_once_and_the_memory_stays_within_its_bound(
    source_of, cache_bytes, stagings
):
    """Nine epochs, of which the last six renew a third of the slots each."""
    source = source_of("endless", keep=3, workers=0, cache_bytes=cache_bytes)
    stager = source._workers[0]._stager
    stage, staged = stager._stage, []
    stager._stage = lambda episode: staged.append(episode) or stage(episode)
    for epoch in range(9):
        read(source, range(epoch * SLOTS, (epoch + 1) * SLOTS), [epoch] * SLOTS)
        assert 0 <= stager._room == cache_bytes - sum(one.bytes for one in stager._kept.values())
    if stagings is None:
        assert 6 * SLOTS // 3 < len(staged) < 9 * SLOTS
    else:
        assert len(staged) == stagings


def test_the_fingerprint_tells_what_the_episodes_are_made_from(source_of):
    def digest(config=GENERATE, **options):
        return source_of("endless", config=config, **{"keep": 2, "workers": 0, **options}).digest

    assert digest() == digest(cache_bytes=0)
    changed = [
        digest(keep=3),
        digest(episodes=2),
        digest(GENERATE.model_copy(update={"fps": 9.0})),
        digest(GENERATE.model_copy(update={"motions": GENERATE.motions[::-1]})),
        digest(GENERATE.model_copy(update={"primitives": [Choice(name="cone")]})),
    ]
    assert len({digest(), *changed}) == 1 + len(changed)
    assert digest(GENERATE.model_copy(update={"episodes_per_shard": 1})) == digest()


def test_an_epoch_has_as_many_episodes_as_the_option_says(source_of):
    more = source_of("endless", episodes=5, workers=0, keep=1)
    assert len(more) == 10
    plain = source_of("endless", workers=0, keep=1)
    assert same_moments(read(more, [6, 9], [3, 3]), read(plain, [SLOTS, SLOTS + 3], [3, 3]))


@pytest.mark.parametrize(
    ("options", "fault"),
    [({"keep": 0}, "keep"), ({"workers": -1}, "workers"), ({"episodes": 0}, "episodes"), ({"kep": 3}, "kep")],
)
def test_wrong_options_are_named(source_of, options, fault):
    with pytest.raises(ConfigError, match=f"source 'endless': option '{fault}'"):
        source_of("endless", **options)


def test_an_unknown_source_prints_the_choices_and_the_nearest(source_of):
    with pytest.raises(ConfigError, match="unknown source 'endles'") as caught:
        source_of("endles")
    assert "did you mean 'endless'" in caught.value.hint
    assert "shards" in caught.value.hint


class NoOptions(Options):
    pass


class Hasty:
    """Plans half of what it is asked for."""

    @hookimpl
    def geoprior_motions(self):
        pick = plugins().build("motion", Choice(name="pick"))
        hasty = type("Motion", (), {"plan": lambda _, scene, steps, rng: pick.plan(scene, steps // 2, rng)})
        yield MotionSpec(name="hasty", summary="", config=NoOptions, factory=lambda _: hasty())


def test_a_motion_of_another_length_is_named(source_of, fresh_plugins, monkeypatch):
    fresh_plugins.register(Hasty(), name="hasty", package="tests", version="1")
    monkeypatch.setattr("geoprior.synthesis.studio.plugins", lambda: fresh_plugins)
    config = GENERATE.model_copy(update={"motions": [Choice(name="hasty")]})
    with pytest.raises(PluginError, match="motion 'hasty': planned 10 time steps where 20"):
        source_of("endless", config=config, workers=0)


def test_a_config_that_cannot_be_staged_is_said_as_in_generation(source_of):
    config = GENERATE.model_copy(update={"motions": [Choice(name="place")], "seconds": 0.2})
    with pytest.raises(ConfigError) as of_generation:
        synthesise(config, CAMERAS, SEED, config.motions[0], 0)
    with pytest.raises(ConfigError) as of_training:
        source_of("endless", config=config, workers=0)
    assert str(of_training.value) == str(of_generation.value)
