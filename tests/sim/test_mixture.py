"""Demonstrations of many tasks in one folder: the data of the same-environment condition."""

from __future__ import annotations

import hashlib
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from quick_demos import Shuffled

from geoprior.config import load_config
from geoprior.errors import ConfigError, DataError
from geoprior.executors.local import SerialExecutor
from geoprior.files import read_json
from geoprior.hooks.manager import plugins
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.verify import verify
from geoprior.sim.config import SameEnvironmentConfig
from geoprior.sim.mixture import MIXTURE, collect_mixture, shares

THREE = SameEnvironmentConfig(tasks=["pick", "place", "push"], episodes=7, first_state=40)


def _collect(out: Path, executor, cameras, config: SameEnvironmentConfig = THREE, seed: int = 0):
    return collect_mixture(config, cameras=cameras, seed=seed, executor=executor, out=out)


def _bytes(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@given(episodes=st.integers(9, 2000), count=st.integers(1, 9))
def test_episodes_are_shared_out_evenly(episodes, count):
    tasks = [f"task-{number}" for number in range(count)]
    given_out = shares(SameEnvironmentConfig(tasks=tasks, episodes=episodes))
    numbers = [number for _, number in given_out]
    assert [task.name for task, _ in given_out] == tasks
    assert sum(numbers) == episodes
    assert max(numbers) - min(numbers) <= 1
    assert max(numbers) * 3 <= SameEnvironmentConfig(tasks=tasks, episodes=episodes).max_attempts


def test_every_task_gives_its_share_to_one_data_set(fast_episodes, tmp_path, cameras):
    manifest = _collect(tmp_path, SerialExecutor(), cameras)
    assert Counter(key.rpartition("-")[0] for key in manifest.keys) == {"pick": 3, "place": 2, "push": 2}
    store = EpisodeStore(tmp_path)
    assert len(store) == 7
    assert {store.header(number).source for number in range(7)} == {"simulated"}
    assert list(verify(tmp_path)) == []
    attempts = read_json(tmp_path / MIXTURE)["attempts"]
    assert [each["success"] for each in attempts["pick"]] == [True, False, True, True]
    assert [each["state_seed"] for each in attempts["place"]] == [40, 41, 42]


@pytest.mark.parametrize("stop_after", [0, 2, 5, 8])
def test_interrupted_mixture_goes_on_to_the_same_bytes(fast_episodes, tmp_path, cameras, stop_after):
    _collect(tmp_path / "whole", SerialExecutor(), cameras)
    with pytest.raises(KeyboardInterrupt):
        _collect(tmp_path / "cut", Shuffled(1, stop_after), cameras)
    _collect(tmp_path / "cut", SerialExecutor(), cameras)
    assert _bytes(tmp_path / "cut") == _bytes(tmp_path / "whole")
    idle = Shuffled(3, stop_after=0)
    _collect(tmp_path / "cut", idle, cameras)
    assert idle.ran == 0


@pytest.mark.parametrize("moved", [0, 1, 4, 6])
def test_killed_while_shards_move_it_goes_on_to_the_same_bytes(
    fast_episodes, tmp_path, cameras, moved, monkeypatch
):
    _collect(tmp_path / "whole", SerialExecutor(), cameras)
    rename, done = Path.rename, []

    def stop(source, target):
        if len(done) == moved:
            raise KeyboardInterrupt
        done.append(target)
        return rename(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", stop)
        with pytest.raises(KeyboardInterrupt):
            _collect(tmp_path / "cut", SerialExecutor(), cameras)
    assert len(list((tmp_path / "cut").glob("*.tar"))) == moved
    _collect(tmp_path / "cut", SerialExecutor(), cameras)
    assert _bytes(tmp_path / "cut") == _bytes(tmp_path / "whole")


@pytest.mark.parametrize("file", ["place-000002.tar", "manifest.json"])
def test_what_is_lost_alone_is_made_again(fast_episodes, tmp_path, cameras, file):
    _collect(tmp_path, SerialExecutor(), cameras)
    before = _bytes(tmp_path)
    (tmp_path / file).unlink()
    again = Shuffled(2)
    _collect(tmp_path, again, cameras)
    assert _bytes(tmp_path) == before
    assert (again.ran > 0) == file.endswith(".tar")


def test_other_data_in_the_folder_are_refused(fast_episodes, tmp_path, cameras):
    _collect(tmp_path, SerialExecutor(), cameras)
    with pytest.raises(DataError, match="other data"):
        _collect(tmp_path, SerialExecutor(), cameras, seed=1)
    (tmp_path / MIXTURE).unlink()
    with pytest.raises(DataError, match="other data"):
        _collect(tmp_path, SerialExecutor(), cameras)


@pytest.mark.parametrize(
    "options", [{"tasks": ["pick", "pick"]}, {"tasks": []}, {"episodes": 8}, {"control_rate": 30}]
)
def test_impossible_mixtures_are_refused(options):
    with pytest.raises(ValidationError):
        SameEnvironmentConfig(**options)


def test_the_preset_is_the_papers_nine_tasks_and_600_episodes():
    config = load_config("same-environment", [], plugins())
    wanted = config.same_environment
    assert (len(wanted.tasks), wanted.episodes, wanted.robot.name) == (9, 600, "ur5e")
    assert {"pick", "place", "push", "pile", "door"} < {task.name for task in wanted.tasks}
    paper = load_config("paper", [], plugins())
    assert config.finetune == paper.finetune
    assert config.pretrain.epochs == paper.pretrain.epochs


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("same_environment={first_state: 2999900}", "same_environment may use the initial states"),
        ("same_environment={control_rate: 20}", "same_environment.control_rate / pretrain.skip = 20 Hz"),
        ("same_environment={tasks: [nonsense]}", "nonsense"),
        ("same_environment={robot: nonsense}", "nonsense"),
    ],
)
def test_a_config_that_cannot_work_is_refused_by_key(override, message):
    with pytest.raises(ConfigError, match="same_environment") as caught:
        load_config("lite", [override], plugins())
    assert message in str(caught.value)


def test_an_endless_source_does_not_read_the_mixture():
    with pytest.raises(ConfigError, match="does not read them"):
        load_config("lite", ["pretrain.source=endless", "same_environment={}"], plugins())
