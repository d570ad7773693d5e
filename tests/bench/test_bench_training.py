"""The benchmarks of training and of inference, on a policy and frames that are small."""

import time

import pytest
import torch

from benchmarks import inference, training
from geoprior.options import Choice
from geoprior.policies.policy import Features

TINY = Choice(
    name="act",
    options={
        "dim": 16,
        "heads": 2,
        "ffn": 16,
        "encoder_layers": 1,
        "vae_layers": 1,
        "latent": 4,
        "trunk_width": 8,
    },
)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    for module in (training, inference):
        monkeypatch.setattr(module, "COMPACT", TINY)
        monkeypatch.setattr(module, "LARGE", TINY)
    monkeypatch.setattr(training, "SIZE", 32)
    monkeypatch.setattr(training, "RATE_GOAL", 0.001)
    monkeypatch.setattr(inference, "FEATURES", Features(("hand", "third"), (32, 32), ("hand",), 25))


def test_training_is_told_with_its_floor():
    metrics = {metric.metric: metric for metric in training._measure(rounds=1, steps=1, goals=True)}
    rate = metrics["compact: 2 cameras, batch 64, bf16"]
    assert rate.met is True
    assert 0.0 <= metrics["compact: share of time that a step waits for its batch"].value < 1.0
    for label, size in (("compact", 64), ("dim 512", 8), ("dim 512", 32)):
        step = f"{label}, batch {size}, bf16"
        took = 1e3 * size / metrics[step].value
        floor = metrics[f"{step}: floor of a step by arithmetic and AdamW's memory"].value
        assert metrics[f"{step}: a step over its floor"].value == pytest.approx(took / floor)
    arithmetic = [metrics[f"dim 512, batch {size}, fp32: arithmetic of a step"].value for size in (8, 32)]
    assert 3.5 < arithmetic[1] / arithmetic[0] <= 4.0


def test_inference_is_told_by_prediction_and_by_observation():
    metrics = {metric.metric: metric.value for metric in inference._measure(1)}
    assert len(metrics) == 24
    for rows in inference.ROWS:
        of = f"compact, bf16, {rows} at once"
        assert metrics[f"{of}: a prediction"] == pytest.approx(rows * metrics[f"{of}: an observation"])


def test_a_machines_rates_are_those_of_its_clock(monkeypatch):
    seconds = iter(range(1000))
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(seconds)))
    rates = training.machine_rates(torch.float32, size=100)
    assert rates.operations == 2.0 * 100**3
    assert rates.bytes == 2 * 4 * 2**25
