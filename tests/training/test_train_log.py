import json
from pathlib import Path

import pytest

from geoprior import TrainStep
from geoprior.errors import DataError
from geoprior.training.loggers import log_file


@pytest.fixture
def log(tmp_path):
    def say(step, loss=0.5):
        event = TrainStep("pretrain", step, 100, step / 10, {"loss": loss}, tmp_path)
        log_file.geoprior_train_step(event)
        return [json.loads(line)["step"] for line in (tmp_path / "log.jsonl").read_text().splitlines()]

    yield say
    log_file._last_step.clear()


def test_one_line_a_step(log, tmp_path):
    log(10)
    assert log(20) == [10, 20]
    line = json.loads((tmp_path / "log.jsonl").read_text().splitlines()[0])
    assert line == {"step": 10, "epoch": 1.0, "loss": 0.5}


@pytest.mark.parametrize("new_process", [True, False])
def test_going_back_drops_what_came_after(log, new_process):
    for step in (10, 20, 30, 40):
        log(step)
    if new_process:
        log_file._last_step.clear()
    assert log(30) == [10, 20, 30]
    assert log(40) == [10, 20, 30, 40]


@pytest.mark.parametrize("torn", ['{"step": 30, "ep', '{"step": 30}', "\x00\x00\n", "[]\n"])
def test_a_torn_line_goes_with_what_follows_it(log, tmp_path, torn):
    log(10)
    log(20)
    with (tmp_path / "log.jsonl").open("a") as file:
        file.write(torn)
    log_file._last_step.clear()
    assert log(40) == [10, 20, 40]


def test_a_full_disk_ends_with_a_sentence(log, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    log(10)
    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(DataError, match=r"log.jsonl: cannot be written \(No space left on device\)"):
        log(20)


def test_a_deleted_log_begins_anew(log, tmp_path):
    log(10)
    (tmp_path / "log.jsonl").unlink()
    assert log(20) == [20]
