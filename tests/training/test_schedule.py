"""The learning rate's schedule: its values, torch's own as reference, and a resumed training to the bit."""

import itertools
import json

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from torch.optim.lr_scheduler import CosineAnnealingLR
from training_material import make_training

from geoprior.options import recipe_tree
from geoprior.policies.checkpoint import list_checkpoints, load_checkpoint
from geoprior.training.config import FinetuneConfig, PretrainConfig, TrainConfig
from geoprior.training.loop import fit
from geoprior.training.schedule import rate_at

STEPS = 110


def shares(**options):
    config = TrainConfig(**options)
    return [rate_at(config, step, STEPS) for step in range(STEPS)]


def test_without_options_the_rate_never_changes():
    assert set(shares()) == {1.0}
    assert shares(warmup_steps=4) == [0.25, 0.5, 0.75, *[1.0] * (STEPS - 3)]


def test_a_cosine_rises_falls_to_the_middle_and_ends_at_the_final_share():
    found = shares(schedule="cosine", warmup_steps=10, final_rate=0.1)
    assert found[:10] == [(step + 1) / 10 for step in range(10)]
    assert found[10] == 1.0
    assert found[60] == pytest.approx(0.55)
    assert found[-1] == pytest.approx(0.1, abs=1e-3)
    assert all(later < earlier for earlier, later in itertools.pairwise(found[10:]))


def test_without_a_final_rate_it_ends_at_zero_but_no_step_is_wasted():
    found = shares(schedule="cosine")
    assert 0.0 < found[-1] < 1e-3


@given(warmup=st.integers(0, STEPS - 2), final=st.floats(0.0, 1.0))
def test_a_cosine_is_torchs(warmup, final):
    weight = torch.nn.Parameter(torch.zeros(1))
    optimizer = torch.optim.SGD([weight], lr=1.0)
    theirs = CosineAnnealingLR(optimizer, STEPS - warmup, eta_min=final)
    ours = shares(schedule="cosine", warmup_steps=warmup, final_rate=final)
    for share in ours[warmup:]:
        assert share == pytest.approx(theirs.get_last_lr()[0], abs=1e-9)
        optimizer.step()
        theirs.step()


@given(warmup=st.integers(STEPS, 3 * STEPS))
def test_a_warm_up_longer_than_the_training_is_all_there_is(warmup):
    assert shares(schedule="cosine", warmup_steps=warmup) == shares(warmup_steps=warmup)


def test_a_final_rate_needs_a_cosine():
    with pytest.raises(ValidationError, match=r"final_rate 0\.1: schedule is constant; set it to cosine"):
        TrainConfig(final_rate=0.1)


@pytest.mark.parametrize("model", [PretrainConfig, FinetuneConfig])
def test_at_its_default_it_does_not_enter_a_recipe(model):
    assert not {"schedule", "final_rate"} & recipe_tree(model()).keys()
    assert recipe_tree(model(schedule="cosine"))["schedule"] == "cosine"


def test_every_group_gets_its_share_and_the_log_says_it(fake_store, tmp_path):
    options = {"schedule": "cosine", "warmup_steps": 2, "learning_rate": 0.01, "trunk_learning_rate": 0.02}
    training = make_training(fake_store, tmp_path, epochs=8, **options)
    fit(training)
    lines = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert [line["learning_rate"] for line in lines] == [
        0.01 * rate_at(training.config, step, training.steps) for step in range(training.steps)
    ]


class StoppedError(Exception):
    """A training that ends in its middle."""


@pytest.mark.parametrize("stop", [1, 3, 7])
def test_a_cosine_resumes_to_the_bit(fake_store, tmp_path, stop):
    options = {"epochs": 8, "schedule": "cosine", "warmup_steps": 3, "resume_seconds": 0.0}
    whole = make_training(fake_store, tmp_path / "whole", **options)
    fit(whole)
    cut = make_training(fake_store, tmp_path / "cut", **options)
    plain, calls = cut.policy.loss, []

    def stopping(batch):
        calls.append(1)
        if len(calls) > stop:
            raise StoppedError
        return plain(batch)

    cut.policy.loss = stopping
    with pytest.raises(StoppedError):
        fit(cut)
    fit(make_training(fake_store, tmp_path / "cut", **options))
    ends = [load_checkpoint(list_checkpoints(tmp_path / name)[-1].path)[1] for name in ("whole", "cut")]
    for name, tensor in ends[0].items():
        assert torch.equal(tensor, ends[1][name])
