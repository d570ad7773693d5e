"""Pretraining on fresh episodes: to the bit what it must be, and alone in the world when it ends."""

import multiprocessing
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from training_material import TINY_ACT

from geoprior import hookimpl
from geoprior.errors import NumericalError
from geoprior.executors.local import SerialExecutor
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.checkpoint import list_checkpoints, load_checkpoint
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.generate import generate
from geoprior.training.config import PretrainConfig
from geoprior.training.stages import pretrain

HERE = Path(__file__).parent
SEED = 5
GENERATE = GenerateConfig(episodes=4, seconds=2, motions=["pick"])
CAMERAS = CamerasConfig(height=32, width=32)
COMMON = {
    "epochs": 6,
    "batch_size": 4,
    "threads": 1,
    "precision": "fp32",
    "log_every": 1,
    "resume_seconds": 0.0,
}


def train_endless(out, **options):
    source = Choice(name="endless", options={"keep": 2, "workers": 0, **options})
    return train(out, out / "no shards are read", source)


def train(out, data, source):
    config = PretrainConfig(source=source, **COMMON)
    return pretrain(
        config, policy=TINY_ACT, seed=SEED, data=data, generate=GENERATE, cameras=CAMERAS, out=out
    )


def weights(folder):
    return [checkpoint.path.read_bytes() for checkpoint in list_checkpoints(folder)]


class AtStep:
    """Does something once, when a training has made so many steps."""

    def __init__(self, step, action):
        self.step, self.action = step, action

    @hookimpl
    def geoprior_train_step(self, event):
        if event.step == self.step:
            action, self.action = self.action, lambda: None
            action()


@pytest.fixture
def at_step():
    registered = []

    def register(step, action):
        registered.append(AtStep(step, action))
        plugins()._manager.register(registered[-1])

    yield register
    for plugin in registered:
        plugins()._manager.unregister(plugin)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """An undisturbed training without workers."""
    folder = tmp_path_factory.mktemp("whole")
    train_endless(folder)
    return folder


def test_kept_to_the_end_it_is_the_training_on_the_shards(tmp_path):
    data = tmp_path / "shards"
    generate(GENERATE, CAMERAS, seed=SEED, executor=SerialExecutor(), out=data)
    train(tmp_path / "recorded", data, Choice(name="shards"))
    train_endless(tmp_path / "endless", keep=6)
    assert (tmp_path / "recorded" / "log.jsonl").read_text() == (
        tmp_path / "endless" / "log.jsonl"
    ).read_text()
    (path,), (other,) = (list_checkpoints(tmp_path / name) for name in ("recorded", "endless"))
    (header, tensors), (other_header, other_tensors) = load_checkpoint(path.path), load_checkpoint(other.path)
    assert header.statistics == other_header.statistics
    assert all(tensors[name].equal(other_tensors[name]) for name in tensors | other_tensors)
    digests = {h.details["data"]["digest"] for h in (header, other_header)}
    assert len(digests) == 2, "a checkpoint tells what it was trained on"


def test_a_worker_and_a_resume_change_nothing_and_an_interrupt_leaves_no_process(whole, tmp_path, at_step):
    def interrupt():
        assert len(multiprocessing.active_children()) == 1
        raise KeyboardInterrupt

    at_step(3, interrupt)
    with pytest.raises(KeyboardInterrupt):
        train_endless(tmp_path, workers=1)
    assert multiprocessing.active_children() == []
    train_endless(tmp_path, workers=0)
    assert weights(tmp_path) == weights(whole)


def test_a_training_that_fails_or_is_done_leaves_no_process(tmp_path, at_step):
    def fail():
        raise NumericalError("the loss is not finite")

    at_step(2, fail)
    with pytest.raises(NumericalError):
        train_endless(tmp_path, workers=1)
    assert multiprocessing.active_children() == []
    train_endless(tmp_path, workers=1)
    assert multiprocessing.active_children() == []


SLOW = """
import multiprocessing, pathlib, sys, time
sys.path.insert(0, sys.argv[1])
from test_endless_training import AtStep, plugins, train_endless

def wait():
    (worker,) = multiprocessing.active_children()
    pathlib.Path(sys.argv[3]).write_text(f"{worker.pid} ")
    time.sleep(600)

if __name__ == "__main__":
    plugins()._manager.register(AtStep(3, wait))
    train_endless(pathlib.Path(sys.argv[2]), workers=1)
"""


def test_killed_it_takes_its_worker_along_and_goes_on_to_the_same_bytes(whole, tmp_path):
    script, said, out = tmp_path / "slow.py", tmp_path / "worker", tmp_path / "run"
    script.write_text(SLOW)
    process = subprocess.Popen([sys.executable, str(script), str(HERE), str(out), str(said)])
    try:
        wait_until(lambda: process.poll() is not None or (said.exists() and said.read_text().endswith(" ")))
        assert process.poll() is None, "it ended before it could be killed"
    finally:
        process.kill()
        process.wait()
    worker = int(said.read_text())
    wait_until(lambda: not alive(worker), seconds=30)
    train_endless(out, workers=0)
    assert weights(out) == weights(whole)


def alive(pid):
    with suppress(ProcessLookupError):
        os.kill(pid, 0)
        return True
    return False


def wait_until(condition, seconds=120):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)
