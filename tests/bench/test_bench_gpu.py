"""The GPU benchmark, on the CPU: nobody has run it on a GPU here."""

from contextlib import closing, nullcontext
from dataclasses import replace

import pytest

from benchmarks import gpu
from geoprior.options import Choice

TINY = replace(
    gpu.QUICKSTART,
    height=32,
    width=32,
    policy=Choice(name="act", options={"chunk": 25, "dim": 16, "heads": 2, "ffn": 16, "trunk_width": 8}),
    batches=(4,),
)


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    with closing(gpu._source(tmp_path_factory.mktemp("gpu"), TINY)) as made:
        yield made


def test_a_device_that_computes_the_same_differs_by_nothing(source, monkeypatch):
    monkeypatch.setattr(gpu, "STEPS", 3)
    assert gpu._loss_difference(source, TINY, "cpu") == 0.0


def test_a_device_that_computes_otherwise_is_seen(source, monkeypatch):
    """Other noise in the style, as another device would draw it, is far above what rounding does."""
    monkeypatch.setattr(gpu, "STEPS", 3)
    with_none = gpu._losses(source, TINY, "cpu")
    monkeypatch.setattr(gpu, "_without_noise", nullcontext)
    with_some = gpu._losses(source, TINY, "cpu")
    assert max(abs(a - b) / abs(a) for a, b in zip(with_none, with_some, strict=True)) > gpu.SAME


def test_speed_is_told_with_the_loader(source):
    told = list(gpu._speed(source, TINY, 4, "fp32", "cpu", 2))
    assert [metric.unit for metric in told] == ["samples/s"]
    assert told[0].value > 0.0


def test_the_hours_of_the_paper_count_every_training():
    """2,000 epochs of 600 episodes, and 5,000 of 20 for each of two conditions and three seeds."""
    assert gpu._hours(1.0) * 3600.0 == pytest.approx(2000 * 600 + 5000 * 20 * 6)


@pytest.mark.slow
def test_a_training_that_is_killed_goes_on_to_the_same_bits():
    (told,) = gpu._killed("cpu")
    assert told.met is True
