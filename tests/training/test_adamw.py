"""The optimiser that lends bfloat16 weights, against torch's own under autocast."""

from dataclasses import replace

import pytest
import torch
from torch import nn
from training_material import FakeStore, LinearPolicy, make_demonstration, make_training

from geoprior.policies.halves import LARGE
from geoprior.training.adamw import AdamW, HalfAdamW
from geoprior.training.loop import fit
from geoprior.training.machine import Machine
from geoprior.training.optimise import make_optimizer
from geoprior.training.resume import Progress, load_progress, save_progress

DECAY, RATE = 1e-2, 1e-3


class Net(nn.Module):
    """Matrices and kernels that are lent, one in another memory layout, and parameters that are not."""

    def __init__(self):
        super().__init__()
        self.conv = nn.Conv2d(16, 128, 3, padding=1).to(memory_format=torch.channels_last)
        self.norm = nn.LayerNorm(128)
        self.head = nn.Linear(128, 130)
        self.small = nn.Linear(130, 3)

    def forward(self, x):
        x = self.conv(x).mean((2, 3))
        return self.small(torch.relu(self.head(self.norm(x)))).float().square().mean()


def nets():
    torch.manual_seed(0)
    first, second = Net(), Net()
    second.load_state_dict(first.state_dict())
    return first, second


def groups(net):
    first, *rest = net.parameters()
    return [{"params": [first], "lr": RATE / 10}, {"params": rest, "lr": RATE}]


def steps(net, optimizer, count, clip=None):
    torch.manual_seed(1)
    losses = []
    for _ in range(count):
        with optimizer.lend(), torch.autocast("cpu", torch.bfloat16):
            loss = net(torch.randn(4, 16, 6, 6))
            optimizer.zero_grad()
            loss.backward()
        if clip is not None:
            losses.append(optimizer.clip(clip))
        optimizer.step()
        losses.append(loss.item())
    return losses


@pytest.mark.parametrize("clip", [None, 0.05])
def test_it_takes_the_steps_of_torchs_adamw_under_autocast(clip):
    ours, reference = nets()
    optimizer = HalfAdamW(groups(ours), DECAY)
    found = steps(ours, optimizer, 12, clip)
    expected = steps(reference, AdamW(groups(reference), DECAY), 12, clip)
    assert found == pytest.approx(expected, rel=2e-3)
    assert found[0] == pytest.approx(expected[0], rel=1e-6)
    for ours_now, theirs in zip(ours.parameters(), reference.parameters(), strict=True):
        assert ours_now.dtype == torch.float32
        assert ours_now.stride() == theirs.stride()
        # Adam's first steps are as large as the rate wherever a gradient's sign is in doubt.
        assert (ours_now - theirs).abs().median() < 1e-5
        assert (ours_now - theirs).abs().max() < 12 * 2 * RATE


def test_one_step_from_the_same_gradient_is_torchs_to_float32():
    weight = nn.Parameter(torch.randn(200, 300))
    twin = nn.Parameter(weight.detach().clone())
    optimizer = HalfAdamW([{"params": [weight], "lr": RATE}], DECAY)
    reference = AdamW([{"params": [twin], "lr": RATE}], DECAY)
    for _ in range(5):
        gradient = torch.randn(200, 300).to(torch.bfloat16)
        with optimizer.lend():
            weight.grad = gradient
        twin.grad = gradient.float()
        optimizer.step()
        reference.step()
    torch.testing.assert_close(weight.data, twin.data, atol=1e-6, rtol=1e-6)
    for name in ("step", "exp_avg", "exp_avg_sq"):
        torch.testing.assert_close(
            optimizer.state[weight][name], reference.state[twin][name], rtol=1e-5, atol=1e-6
        )


def test_what_is_lent_is_the_weight_rounded_to_bfloat16():
    net, _ = nets()
    optimizer = HalfAdamW(groups(net), DECAY)
    steps(net, optimizer, 3)
    whole = {name: parameter.detach().clone() for name, parameter in net.named_parameters()}
    with optimizer.lend():
        lent = {name: parameter.detach().clone() for name, parameter in net.named_parameters()}
    for name, weight in whole.items():
        large = weight.dim() > 1 and weight.numel() >= LARGE
        assert lent[name].dtype == (torch.bfloat16 if large else torch.float32)
        assert torch.equal(lent[name], weight.to(lent[name].dtype)), name
    assert {name for name, weight in lent.items() if weight.dtype == torch.bfloat16} == {
        "conv.weight",
        "head.weight",
    }


def test_weights_come_back_when_a_step_fails():
    net, _ = nets()
    optimizer = HalfAdamW(groups(net), DECAY)
    with pytest.raises(RuntimeError, match="midway"), optimizer.lend():
        raise RuntimeError("midway")
    assert {parameter.dtype for parameter in net.parameters()} == {torch.float32}


def test_loaded_weights_are_lent_after_a_refresh():
    net, other = nets()
    optimizer = HalfAdamW(groups(net), DECAY)
    with torch.no_grad():
        for parameter in net.parameters():
            parameter.add_(1.0)
    optimizer.refresh()
    with optimizer.lend():
        assert torch.equal(net.head.weight, (other.head.weight + 1.0).to(torch.bfloat16))


def test_a_parameter_without_a_gradient_stays():
    net, other = nets()
    optimizer = HalfAdamW(groups(net), DECAY)
    with optimizer.lend(), torch.autocast("cpu", torch.bfloat16):
        net.norm(net.conv(torch.randn(2, 16, 6, 6)).mean((2, 3))).sum().backward()
    optimizer.step()
    assert torch.equal(net.head.weight, other.head.weight)
    assert not torch.equal(net.conv.weight, other.conv.weight)


def test_a_training_that_goes_on_takes_the_same_steps(tmp_path):
    whole, cut = nets()
    whole_optimizer = HalfAdamW(groups(whole), DECAY)
    steps(whole, whole_optimizer, 6)
    begun = HalfAdamW(groups(cut), DECAY)
    steps(cut, begun, 6)
    save_progress(tmp_path, "one", Progress(6, 0.0, {}), cut, begun)
    later, _ = nets()
    optimizer = HalfAdamW(groups(later), DECAY)
    load_progress(tmp_path, "one", later, optimizer)
    optimizer.refresh()
    assert steps(later, optimizer, 5) == steps(whole, whole_optimizer, 5)
    for found, expected in zip(later.parameters(), whole.parameters(), strict=True):
        assert torch.equal(found, expected)


class PartlyFloat32(LinearPolicy):
    """Switches autocast off for a part of its loss, as many policies do."""

    def __init__(self, features):
        super().__init__(features)
        self.widen, self.narrow = torch.nn.Linear(8, 4096), torch.nn.Linear(4096, 8)

    def act(self, observation):
        base = super().act(observation)
        with torch.autocast("cpu", enabled=False):
            return base.float() + self.narrow(self.widen(observation["pose"].float()).tanh())[:, None]


def test_half_weights_are_lent_only_to_a_policy_that_takes_them(tmp_path):
    store = FakeStore([make_demonstration(index, steps=6) for index in range(4)])
    training = make_training(store, tmp_path, precision="bf16")
    policy = PartlyFloat32(training.policy.features)
    training = replace(training, policy=policy, machine=Machine("cpu", "bf16", 1))
    assert fit(training)["metrics"]["l1"] > 0.0
    policy.half_weights = True
    assert isinstance(make_optimizer(training.config, policy, training.machine), HalfAdamW)
