"""The moving average of the weights: what checkpoints hold where it is asked for."""

import pytest
import torch
from training_material import make_training

from geoprior.errors import ConfigError
from geoprior.policies.checkpoint import list_checkpoints, load_checkpoint
from geoprior.training.average import EVERY, WeightAverage
from geoprior.training.config import TrainConfig
from geoprior.training.loop import fit


class Weights(torch.nn.Module):
    def __init__(self, value=0.0):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.full((3,), value))
        self.register_buffer("steps", torch.tensor(0))


def average_of(values, decay):
    policy = Weights(values[0])
    average = WeightAverage(policy, decay)
    for step, value in enumerate(values, start=1):
        with torch.no_grad():
            policy.weight.fill_(value)
        policy.steps.fill_(step)
        average.update(policy, step)
    return average.policy


def test_the_average_of_a_constant_is_the_constant():
    assert torch.equal(average_of([0.25] * 40, 0.99).weight, torch.full((3,), 0.25))


def test_the_average_forgets_the_beginning():
    early = average_of([100.0] * EVERY + [1.0] * 40 * EVERY, 0.999).weight
    assert (early - 1.0).abs().max() < 5.0


def test_a_slower_decay_looks_farther_back():
    rising = [float(step) for step in range(2000)]
    fast, slow = (average_of(rising, decay).weight[0].item() for decay in (0.9, 0.995))
    assert slow < fast < rising[-1]
    assert rising[-1] - slow == pytest.approx(200.0, rel=0.1)


def test_counters_are_those_of_the_last_update():
    assert average_of([1.0] * 10, 0.9).steps == 10 // EVERY * EVERY


def weights_of(folder):
    return load_checkpoint(list_checkpoints(folder)[-1].path)[1]


def test_checkpoints_hold_the_average_and_the_training_goes_its_own_way(fake_store, tmp_path):
    plain, averaged = (
        make_training(fake_store, tmp_path / str(decay), epochs=16, average=decay) for decay in (0.0, 0.9)
    )
    results = [fit(training) for training in (plain, averaged)]
    assert results[0]["metrics"]["l1"] == results[1]["metrics"]["l1"]
    last, mean = weights_of(plain.folder), weights_of(averaged.folder)
    assert any(not torch.equal(last[name], mean[name]) for name in last)
    assert all(
        torch.equal(tensor, last[name])
        for name, tensor in averaged.policy.state_dict().items()
        if name in last
    )


@pytest.mark.parametrize("decay", [-0.1, 1.0])
def test_a_decay_that_never_forgets_or_is_none_is_refused(decay):
    with pytest.raises((ValueError, ConfigError), match="average"):
        TrainConfig(average=decay)
