"""Trainings in processes side by side: the bits of one after the other, and the same words when one fails."""

import json
import multiprocessing
import os
import shutil
import signal
import threading
import time

import pytest
from training_material import TINY_ACT, write_demonstrations

from geoprior.errors import DataError, MachineError
from geoprior.executors.local import LocalConfig, LocalExecutor, SerialExecutor
from geoprior.geometry.camera import CamerasConfig
from geoprior.synthesis.config import GenerateConfig
from geoprior.training.config import ConditionConfig, FinetuneConfig, PretrainConfig
from geoprior.training.machine import decide_machine
from geoprior.training.side_by_side import logged_epoch
from geoprior.training.stages import finetune, pretrain

COMMON = {"batch_size": 8, "precision": "fp32", "log_every": 1, "resume_seconds": 0.0}
SCRATCH, PRIOR = ConditionConfig(init="scratch"), ConditionConfig(init="prior")


def two_workers():
    return LocalExecutor(LocalConfig(workers=2))


@pytest.fixture(scope="module")
def prior(tmp_path_factory):
    """A prior and a blind one, trained side by side."""
    shards = write_demonstrations(tmp_path_factory.mktemp("synthetic") / "shards", count=4, offset=0.3)
    return train_priors(shards, tmp_path_factory.mktemp("prior"), two_workers())


def train_priors(shards, out, executor):
    config = PretrainConfig(epochs=6, **COMMON)
    setting = {"generate": GenerateConfig(), "cameras": CamerasConfig()}
    pretrain(config, policy=TINY_ACT, seed=3, data=shards, out=out, blind=True, executor=executor, **setting)
    return out


def tune(demos, prior, out, executor, *, epochs, **options):
    conditions = {"scratch": SCRATCH, "prior": PRIOR}
    config = FinetuneConfig(epochs=epochs, conditions=conditions, **{**COMMON, **options})
    return finetune(config, policy=TINY_ACT, seed=3, demos=demos, prior=prior, out=out, executor=executor)


def assert_same_weights(one, other):
    paths = [path.relative_to(one) for path in one.rglob("epoch-*")]
    assert paths
    for path in paths:
        assert (one / path).read_bytes() == (other / path).read_bytes(), path


def kill_a_worker_that_trains(folder, killed):
    """Send SIGKILL to one process as soon as a training has saved its state."""
    deadline = time.monotonic() + 120
    while not list(folder.glob("*/resume.safetensors")):
        if time.monotonic() > deadline:
            return
        time.sleep(0.001)
    process = multiprocessing.active_children()[0]
    os.kill(process.pid, signal.SIGKILL)
    killed.append(process.pid)


def test_a_killed_process_is_said_and_the_same_call_goes_on_to_the_bits_of_one_after_the_other(
    demos, prior, tmp_path
):
    whole = tune(demos, prior, tmp_path / "serial", SerialExecutor(), epochs=200)
    killed = []
    killer = threading.Thread(target=kill_a_worker_that_trains, args=(tmp_path / "cut", killed))
    killer.start()
    with pytest.raises(MachineError, match="a worker process died"):
        tune(demos, prior, tmp_path / "cut", two_workers(), epochs=200)
    killer.join()
    assert killed
    assert not all((tmp_path / "cut" / name / "result.json").exists() for name in whole)
    cut = tune(demos, prior, tmp_path / "cut", two_workers(), epochs=200)
    assert {name: each["metrics"] for name, each in cut.items()} == {
        name: each["metrics"] for name, each in whole.items()
    }
    assert_same_weights(tmp_path / "serial", tmp_path / "cut")


def test_priors_side_by_side_are_those_of_one_after_the_other(prior, tmp_path):
    shards = write_demonstrations(tmp_path / "shards", count=4, offset=0.3)
    assert_same_weights(prior, train_priors(shards, tmp_path / "serial", SerialExecutor()))


def test_the_sentence_of_a_training_that_fails_arrives_and_the_others_are_ended(demos, prior, tmp_path):
    broken = shutil.copytree(prior, tmp_path / "prior")
    (weights,) = broken.glob("epoch-*.safetensors")
    weights.write_bytes(weights.read_bytes()[:-1])
    began = time.monotonic()
    with pytest.raises(DataError, match="not the weights that its JSON describes"):
        tune(demos, broken, tmp_path / "out", two_workers(), epochs=1_000_000)
    assert time.monotonic() - began < 120, "the other training would take days"
    assert multiprocessing.active_children() == []


def test_threads_hang_on_the_config_and_not_on_what_is_left_to_do(demos, prior, tmp_path):
    """One training gets all cores, one of several gets one; a finished one does not change that."""
    config = FinetuneConfig(device="cpu", **COMMON)
    cores = len(os.sched_getaffinity(0))
    assert decide_machine(config, tmp_path / "one").threads == cores
    assert decide_machine(config, tmp_path / "several", side_by_side=True).threads == 1
    own = FinetuneConfig(device="cpu", threads=3, **COMMON)
    assert decide_machine(own, tmp_path / "own", side_by_side=True).threads == 3

    tune(demos, prior, tmp_path / "out", SerialExecutor(), epochs=1)
    shutil.rmtree(tmp_path / "out" / "prior-s0")
    tune(demos, prior, tmp_path / "out", SerialExecutor(), epochs=1)
    for name in ("prior-s0", "scratch-s0"):
        details = json.loads((tmp_path / "out" / name / "epoch-000001.json").read_text())["details"]
        assert details["threads"] == 1


def test_one_bar_counts_the_epochs_of_all(demos, prior, tmp_path, capfd):
    tune(demos, prior, tmp_path, SerialExecutor(), epochs=4)
    first, *_, last = capfd.readouterr().err.splitlines()
    assert first == "finetune: 0/8 epochs begins"
    assert last.startswith("finetune: 8/8 epochs")
    tune(demos, prior, tmp_path, SerialExecutor(), epochs=4)
    assert capfd.readouterr().err.startswith("finetune: 8/8 epochs goes on")


@pytest.mark.parametrize(
    ("content", "epoch"),
    [
        (b"", 0.0),
        (b'{"step": 1, "epoch": 1.5}\n{"step": 2, "ep', 1.5),
        (b'{"step": 1, "epoch": 1.5}\n{"step": 2, "epoch": 3.0}\n', 3.0),
        (b'{"step": 1, "epoch": 1.5}\nwhat is this\n[]\n', 1.5),
        (b'{"step": 1, "epoch": 1.5}\n' * 10_000 + b'{"step": 2, "epoch": 4.0}\n', 4.0),
    ],
)
def test_progress_is_read_from_a_log_that_is_being_written(tmp_path, content, epoch):
    (tmp_path / "log.jsonl").write_bytes(content)
    assert logged_epoch(tmp_path / "log.jsonl") == epoch


def test_without_a_log_there_is_no_progress(tmp_path):
    assert logged_epoch(tmp_path / "log.jsonl") == 0.0
