"""A pretraining that ends when its judges have seen enough, and ends there again after a kill."""

import json
from dataclasses import replace
from functools import partial

import pytest
import torch
from pydantic import ValidationError
from training_material import make_training

from geoprior.options import recipe_tree
from geoprior.policies.checkpoint import list_checkpoints, load_checkpoint
from geoprior.training.config import PretrainConfig
from geoprior.training.judge import has_vision_gain
from geoprior.training.loop import RESULT_NAME, fit
from geoprior.training.resume import RESUME_NAME


class Growing:
    """A gain that only the weights decide, and that grows from checkpoint to checkpoint."""

    def __init__(self, first):
        self.first = [each.detach().clone() for each in first.parameters()]

    def measure(self, policy, machine):
        assert machine.device == "cpu"
        pairs = zip(policy.parameters(), self.first, strict=True)
        return {"vision_gain": sum(float((now.detach() - first).abs().sum()) for now, first in pairs)}


def growing(store, folder, wanted, **options):
    training = make_training(store, folder, epochs=10, batch_size=5, checkpoint_every=2, **options)
    enough = None if wanted is None else partial(has_vision_gain, wanted)
    return replace(training, judges=[Growing(training.policy)], is_enough=enough)


@pytest.fixture
def gains(fake_store, tmp_path):
    fit(growing(fake_store, tmp_path / "whole", None))
    lines = [json.loads(line) for line in (tmp_path / "whole" / "log.jsonl").read_text().splitlines()]
    found = [line["vision_gain"] for line in lines if "vision_gain" in line]
    assert len(found) == 5
    assert found == sorted(found)
    return found


@pytest.mark.parametrize("at", [0, 2])
def test_it_ends_at_the_first_checkpoint_with_the_gain(fake_store, tmp_path, gains, at):
    training = growing(fake_store, tmp_path / "cut", gains[at])
    result = fit(training)
    assert (result["epochs"], result["steps"]) == (2 * (at + 1), 2 * (at + 1))
    assert [checkpoint.epoch for checkpoint in list_checkpoints(tmp_path / "cut")] == [2, 4, 6][: at + 1]
    for checkpoint in list_checkpoints(tmp_path / "cut"):
        whole = load_checkpoint(tmp_path / "whole" / checkpoint.path.name)[1]
        for name, tensor in load_checkpoint(checkpoint.path)[1].items():
            assert torch.equal(tensor, whole[name])
    assert fit(growing(fake_store, tmp_path / "cut", gains[at])) == result, "it is done before"


def test_it_takes_its_budget_where_the_gain_is_never_reached(fake_store, tmp_path, gains):
    result = fit(growing(fake_store, tmp_path / "cut", 2 * gains[-1]))
    assert (result["epochs"], result["steps"]) == (10, 10)


def test_killed_after_the_last_checkpoint_it_ends_there_too(fake_store, tmp_path, gains, monkeypatch):
    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("geoprior.training.loop._is_enough", _only_at_first(killed))
        with pytest.raises(KeyboardInterrupt):
            fit(growing(fake_store, tmp_path / "cut", gains[0]))
    assert (tmp_path / "cut" / RESUME_NAME).exists()
    result = fit(growing(fake_store, tmp_path / "cut", gains[0]))
    assert result["steps"] == 2
    assert result["metrics"]["vision_gain"] == gains[0]
    assert json.loads((tmp_path / "cut" / RESULT_NAME).read_text())["epochs"] == 2


def _only_at_first(killed):
    return lambda _, at_checkpoint, __: killed() if at_checkpoint else False


def test_without_a_judge_that_measures_it_the_budget_is_taken():
    assert not has_vision_gain(0.1, {"held_out_l1": 0.2})
    assert has_vision_gain(0.1, {"vision_gain": 0.1})


def test_it_needs_checkpoints_and_does_not_enter_a_recipe_at_its_default():
    with pytest.raises(ValidationError, match="set checkpoint_every"):
        PretrainConfig(until_vision_gain=0.1)
    assert "until_vision_gain" not in recipe_tree(PretrainConfig())
