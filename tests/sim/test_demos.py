from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from quick_demos import Shuffled

from geoprior.errors import ConfigError, DataError
from geoprior.executors.local import LocalConfig, LocalExecutor, SerialExecutor
from geoprior.files import read_json
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.shards.reader import EpisodeStore
from geoprior.sim import demos
from geoprior.sim.config import DemosConfig
from geoprior.sim.workers import Setup, environment


def _collect(out: Path, executor, cameras, config: DemosConfig | None = None, robot: str = "ur5e"):
    return demos.collect(
        config or DemosConfig(episodes=5, first_state=40),
        robot=Choice(name=robot),
        task=Choice(name="pick"),
        cameras=cameras,
        seed=0,
        executor=executor,
        out=out,
    )


def _bytes(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_first_successes_are_taken_whatever_the_order_of_work(fast_episodes, tmp_path, cameras):
    manifest = _collect(tmp_path / "serial", SerialExecutor(), cameras)
    assert manifest.keys == tuple(f"pick-{number:06d}" for number in (0, 2, 3, 5, 6))
    attempts = read_json(tmp_path / "serial" / "attempts.json")
    assert [each["success"] for each in attempts] == [True, False, True, True, False, True, True]
    assert [each["state_seed"] for each in attempts] == list(range(40, 47))
    assert attempts[1]["reason"] == "dropped"
    assert sum(not each["success"] for each in attempts) == 2
    for seed in range(3):
        out = tmp_path / f"shuffled-{seed}"
        _collect(out, Shuffled(seed), cameras)
        assert _bytes(out) == _bytes(tmp_path / "serial")


@pytest.mark.parametrize("stop_after", [0, 1, 4, 6])
def test_interrupted_collection_goes_on_to_the_same_bytes(fast_episodes, tmp_path, cameras, stop_after):
    _collect(tmp_path / "whole", SerialExecutor(), cameras)
    with pytest.raises(KeyboardInterrupt):
        _collect(tmp_path / "cut", Shuffled(1, stop_after), cameras)
    again = Shuffled(2)
    _collect(tmp_path / "cut", again, cameras)
    assert again.ran <= 12 - stop_after
    assert _bytes(tmp_path / "cut") == _bytes(tmp_path / "whole")
    idle = Shuffled(3, stop_after=0)
    _collect(tmp_path / "cut", idle, cameras)
    assert idle.ran == 0


def test_lost_demonstrations_alone_are_made_again(fast_episodes, tmp_path, cameras):
    manifest = _collect(tmp_path, SerialExecutor(), cameras)
    before = _bytes(tmp_path)
    for record in manifest.shards[1:3]:
        (tmp_path / record.file).unlink()
    (tmp_path / "manifest.json").unlink()
    again = Shuffled(2)
    _collect(tmp_path, again, cameras)
    assert _bytes(tmp_path) == before
    assert 2 <= again.ran < len(manifest.shards)


def test_demonstrations_of_another_config_are_refused(fast_episodes, tmp_path, cameras):
    _collect(tmp_path, SerialExecutor(), cameras)
    with pytest.raises(DataError, match="another config"):
        _collect(tmp_path, SerialExecutor(), cameras, robot="xarm7")
    with pytest.raises(DataError, match="another config"):
        _collect(tmp_path, SerialExecutor(), cameras, DemosConfig(episodes=5, first_state=41))


def test_too_many_failures_are_said_with_their_reasons(fast_episodes, tmp_path, cameras):
    config = DemosConfig(episodes=8, attempts_per_episode=1)
    with pytest.raises(ConfigError, match=r"5 of 8 attempts.*3 x dropped") as caught:
        _collect(tmp_path, SerialExecutor(), cameras, config)
    assert "attempts_per_episode" in caught.value.hint


def test_real_demonstration_round_trips_through_its_shard(env, tmp_path, cameras):
    _collect(tmp_path, SerialExecutor(), cameras, DemosConfig(episodes=1))
    store = EpisodeStore(tmp_path)
    header = store.header(0)
    assert (header.source, header.motion, header.fps) == ("simulated", "pick", 10.0)
    assert [(camera.name, camera.mount) for camera in header.cameras] == [
        ("hand", "hand"),
        ("third", "world"),
    ]
    env.reset(header.seed)
    seen = env.observe()
    episode = store.episode(0)
    np.testing.assert_array_equal(episode.pose[0], seen.pose)
    for name, frame in seen.images.items():
        np.testing.assert_array_equal(episode.images[name][0], frame)


def test_the_last_command_repeats_until_success_has_held(ur5e, cameras, tmp_path):
    """An expert that ends at the goal need not know for how long the task wants to see it."""
    short, long = (Choice(name="pick", options={"sustain": seconds}) for seconds in (0.1, 2.5))
    episodes = []
    for task in (short, long):
        setup = Setup(ur5e, plugins().resolve("task", task), cameras)
        attempt = demos.AttemptTask(0, 0, setup, 10, 0, tmp_path)
        episode, reason, _ = demos.record_expert(environment(setup, 10), attempt)
        assert reason == ""
        episodes.append(episode)
    brief, held = (episode.action for episode in episodes)
    np.testing.assert_array_equal(held[: len(brief)], brief)
    assert len(brief) < len(held)
    assert (held[len(brief) :] == brief[-1]).all()


@pytest.mark.slow
def test_two_spawned_workers_make_the_same_bytes(tmp_path, cameras):
    config = DemosConfig(episodes=4)
    _collect(tmp_path / "serial", SerialExecutor(), cameras, config)
    _collect(tmp_path / "pool", LocalExecutor(LocalConfig(workers=2)), cameras, config)
    assert _bytes(tmp_path / "pool") == _bytes(tmp_path / "serial")


class RunsAhead:
    """Has queued all its work when it is called off, as a pool's workers have some of it."""

    def __init__(self) -> None:
        self.late: list[demos.Attempt] = []

    def run(self, function, items):
        items = iter(enumerate(items))
        try:
            for position, item in items:
                yield position, function(item)
        finally:
            self.late = [function(item) for _, item in items]


def test_attempts_that_are_queued_when_there_are_enough_leave_nothing(fast_episodes, tmp_path, cameras):
    _collect(tmp_path / "serial", SerialExecutor(), cameras)
    executor = RunsAhead()
    _collect(tmp_path / "ahead", executor, cameras)
    assert executor.late
    assert {attempt.steps for attempt in executor.late} == {0}
    assert _bytes(tmp_path / "ahead") == _bytes(tmp_path / "serial")
