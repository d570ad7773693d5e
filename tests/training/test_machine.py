import json

import pytest
import torch

from geoprior.errors import DataError, MachineError
from geoprior.training import machine
from geoprior.training.config import TrainConfig
from geoprior.training.machine import Machine, arithmetic, decide_machine

DEVICE = "cuda" if torch.cuda.is_available() else "cpu"


@pytest.mark.parametrize(("speedup", "precision"), [(3.0, "bf16"), (0.9, "fp32")])
def test_auto_takes_what_was_faster_and_writes_it_down(tmp_path, monkeypatch, speedup, precision):
    monkeypatch.setattr(machine, "measure_bf16_speedup", lambda device: speedup)
    assert decide_machine(TrainConfig(threads=3), tmp_path) == Machine(DEVICE, precision, 3, speedup)
    assert json.loads((tmp_path / "machine.json").read_text())["precision"] == precision


def test_a_decision_is_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "measure_bf16_speedup", lambda device: 3.0)
    decided = decide_machine(TrainConfig(threads=1), tmp_path)
    monkeypatch.setattr(machine, "measure_bf16_speedup", lambda device: 0.5)
    assert decide_machine(TrainConfig(), tmp_path) == decided


def test_the_config_overrides(tmp_path, monkeypatch):
    def forbidden(device):
        raise AssertionError

    monkeypatch.setattr(machine, "measure_bf16_speedup", forbidden)
    assert decide_machine(TrainConfig(precision="fp32", threads=2), tmp_path) == Machine(DEVICE, "fp32", 2)
    assert decide_machine(TrainConfig(precision="bf16", threads=1), tmp_path) == Machine(DEVICE, "bf16", 1)


def test_a_damaged_decision_is_named(tmp_path):
    (tmp_path / "machine.json").write_text('{"speed": "high"}')
    with pytest.raises(DataError, match=r"machine.json: not what a training wrote"):
        decide_machine(TrainConfig(), tmp_path)


def test_the_measurement_measures():
    assert machine.measure_bf16_speedup("cpu", size=64, trials=2) > 0.0


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a GPU")
def test_a_gpu_that_is_not_there_is_said(tmp_path):
    with pytest.raises(MachineError, match="torch finds no GPU"):
        decide_machine(TrainConfig(device="cuda"), tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has a GPU")
def test_a_training_that_began_on_a_gpu_does_not_go_on_without_one(tmp_path):
    (tmp_path / "machine.json").write_text('{"device": "cuda", "precision": "bf16", "threads": 2}')
    with pytest.raises(MachineError, match="torch finds no GPU") as caught:
        decide_machine(TrainConfig(), tmp_path)
    assert "--replace" in caught.value.hint
    assert decide_machine(TrainConfig(device="cpu"), tmp_path).device == "cpu"


def test_on_a_cpu_no_gpu_is_woken(monkeypatch):
    def woken(*_):
        raise AssertionError

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "current_device", woken)
    with arithmetic(Machine("cpu", "bf16", 1)):
        pass


def test_only_the_own_gpus_random_state_is_kept_and_its_convolutions_are_the_same_twice(monkeypatch):
    asked = []
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 4)
    monkeypatch.setattr(torch.cuda, "current_device", lambda: 2)
    monkeypatch.setattr(torch.cuda, "get_rng_state", lambda device: asked.append(device) or torch.zeros(1))
    monkeypatch.setattr(torch.cuda, "set_rng_state", lambda *_: None)
    with arithmetic(Machine("cuda", "fp32", 1)):
        assert torch.backends.cudnn.deterministic
        assert not torch.backends.cudnn.allow_tf32
    assert asked == [2]
    assert not torch.backends.cudnn.deterministic
