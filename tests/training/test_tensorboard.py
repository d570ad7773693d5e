"""Points in event files: all of them, each once, and none where nobody asked."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from training_material import make_training

from geoprior import StageEvent, TrainStep, hookimpl
from geoprior.errors import ConfigError, DataError, MachineError
from geoprior.files import read_json
from geoprior.hooks.manager import plugins
from geoprior.training.loggers import tensorboard
from geoprior.training.loggers.tensorboard import SWITCH
from geoprior.training.loop import fit

HERE = Path(__file__).parent


@pytest.fixture
def asked(monkeypatch):
    monkeypatch.setenv(SWITCH, "1")
    yield
    for folder in list(tensorboard._open):
        tensorboard._close(folder)


def points(folder, name="loss"):
    """Every (step, value), as TensorBoard reads them: what a later file takes back is not there."""
    events = EventAccumulator(str(folder), {"scalars": 0})
    events.Reload()
    return [(event.step, event.value) for event in events.Scalars(name)]


def event_files(folder):
    return sorted(folder.rglob("*tfevents*"))


def say(folder, step, loss=0.5):
    tensorboard.geoprior_train_step(TrainStep("pretrain", step, 100, step / 10, {"loss": loss}, folder))


def test_nothing_is_written_unless_it_is_asked_for(fake_store, tmp_path, monkeypatch):
    for name, said in (("unset", None), ("no", "0")):
        monkeypatch.delenv(SWITCH, raising=False)
        if said is not None:
            monkeypatch.setenv(SWITCH, said)
        fit(make_training(fake_store, tmp_path / name))
        assert event_files(tmp_path) == []


def test_a_training_leaves_its_log_as_points(fake_store, tmp_path, asked):
    result = fit(make_training(fake_store, tmp_path, log_every=4))
    assert [step for step, _ in points(tmp_path)] == [4, 8, 12, 14]
    assert points(tmp_path, "epoch")[-1] == (14, pytest.approx(14 * 3 / 5))
    assert points(tmp_path, "learning_rate")[0][1] == pytest.approx(1e-4)
    assert len(event_files(tmp_path)) == 1
    assert read_json(tmp_path / "result.json") == result
    assert tensorboard._open == {}, "the file of a finished training is closed"


def test_the_switch_changes_nothing_else(fake_store, tmp_path, asked, monkeypatch):
    fit(make_training(fake_store, tmp_path / "with"))
    monkeypatch.delenv(SWITCH)
    fit(make_training(fake_store, tmp_path / "without"))
    for path in (tmp_path / "without").iterdir():
        if path.name != "result.json":
            assert path.read_bytes() == (tmp_path / "with" / path.name).read_bytes()


@pytest.mark.parametrize("new_process", [True, False])
def test_going_back_takes_back_what_came_after(tmp_path, asked, new_process):
    for step in (10, 20, 30, 40):
        say(tmp_path, step, loss=1.0)
    if new_process:
        tensorboard._open.clear()
    for step in (30, 40, 50):
        say(tmp_path, step, loss=2.0)
    assert points(tmp_path) == [(10, 1.0), (20, 1.0), (30, 2.0), (40, 2.0), (50, 2.0)]


class Interrupt:
    armed = True

    @hookimpl(trylast=True)
    def geoprior_train_step(self, event):
        if event.step == 9 and self.armed:
            self.armed = False
            raise KeyboardInterrupt


@pytest.mark.parametrize("resume_seconds", [0.0, 3600.0])
def test_an_interrupted_training_has_every_point_once(fake_store, tmp_path, asked, resume_seconds):
    options = {"checkpoint_every": 3, "resume_seconds": resume_seconds}
    fit(make_training(fake_store, tmp_path / "whole", **options))
    plugins()._manager.register(Interrupt(), name="interrupt")
    try:
        with pytest.raises(KeyboardInterrupt):
            fit(make_training(fake_store, tmp_path / "cut", **options))
        fit(make_training(fake_store, tmp_path / "cut", **options))
    finally:
        plugins()._manager.unregister(name="interrupt")
    assert len(event_files(tmp_path / "cut")) == 2
    assert points(tmp_path / "cut") == points(tmp_path / "whole")


SLOW = """
import pathlib, sys, time
sys.path.insert(0, sys.argv[1])
from training_material import FakeStore, make_demonstration, make_training
from geoprior.training.loop import fit
store = FakeStore([make_demonstration(index, steps=6 + index) for index in range(5)])
training = make_training(store, pathlib.Path(sys.argv[2]), epochs=24, checkpoint_every=4)
loss = training.policy.loss
training.policy.loss = lambda batch: (time.sleep(0.05), loss(batch))[1]
fit(training)
"""


def test_a_killed_training_has_every_point_once(fake_store, tmp_path, asked):
    """A real SIGKILL; the training goes on from its last checkpoint, some steps back."""
    killed, log = tmp_path / "killed", tmp_path / "killed" / "log.jsonl"
    process = subprocess.Popen([sys.executable, "-c", SLOW, str(HERE), str(killed)])
    deadline = time.monotonic() + 60
    while not log.exists() or len(log.read_bytes().splitlines()) < 12:
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.01)
    process.kill()
    process.wait()
    time.sleep(1.1)  # TensorBoard reads event files in the order of the second in their names
    assert len(points(killed)) >= 11, "a point is on the disk before the next step is taken"
    options = {"epochs": 24, "checkpoint_every": 4}
    fit(make_training(fake_store, killed, **options))
    fit(make_training(fake_store, tmp_path / "whole", **options))
    assert len(event_files(killed)) == 2
    assert points(killed) == points(tmp_path / "whole")


@pytest.mark.parametrize("stage", ["generate", "pretrain"])
def test_a_missing_package_is_named_before_the_first_stage(asked, monkeypatch, tmp_path, stage):
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    with pytest.raises(MachineError, match="the package tensorboard is missing") as caught:
        plugins().hook.geoprior_before_stage(event=StageEvent(stage, tmp_path, ""))
    assert "pip install 'geoprior[tensorboard]'" in caught.value.hint
    with pytest.raises(MachineError, match="the package tensorboard is missing"):
        say(tmp_path, 1)


def test_a_switch_that_says_neither_is_refused(monkeypatch, tmp_path):
    monkeypatch.setenv(SWITCH, "ja")
    with pytest.raises(ConfigError, match=f"{SWITCH} is 'ja'"):
        plugins().hook.geoprior_before_stage(event=StageEvent("generate", tmp_path, ""))


def test_a_folder_that_cannot_be_written_is_named(asked, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DataError, match="TensorBoard's event file cannot be written"):
        say(tmp_path / "file" / "folder", 1)


def test_to_be_found_it_needs_neither_torch_nor_tensorboard(run_python):
    run_python(
        "import sys, geoprior.training.loggers.tensorboard\n"
        "assert not {'torch', 'tensorboard'} & set(sys.modules)\n",
        **{SWITCH: "1", "PATH": os.environ["PATH"]},
    )
