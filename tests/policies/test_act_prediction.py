"""ACT's predictions, which have a code of their own, against the network that learns."""

import copy
import pickle

import pytest
import torch

from geoprior.policies.act import _network
from geoprior.policies.act._prediction import PackedAct
from geoprior.policies.policy import Features
from geoprior.policies.trunk import FrozenBatchNorm

CASES = {
    "two cameras": {},
    "frozen": {"trunk_norm": "frozen"},
    "deep": {"decoder_layers": 3, "encoder_layers": 1},
    "heads": {"dim": 24, "heads": 3, "ffn": 40, "decoder_layers": 2},
    "wide": {"dim": 64, "heads": 8, "ffn": 128, "trunk_width": 16},
}
FEATURES = {
    "two cameras": Features(("hand", "third"), (40, 64), ("hand",), 5),
    "one camera": Features(("hand",), (33, 71), ("hand",), 1),
    "two hands": Features(("a", "b", "c"), (96, 32), ("left", "right"), 9),
}


@pytest.fixture
def make_shaken_act(make_act):
    """Numbers that begin as zeros and ones are any."""

    def make(**options):
        act = make_act(**options).eval()
        generator = torch.Generator().manual_seed(3)
        numbers = [*act.parameters(), *act.trunk.buffers()]
        for tensor in numbers:
            if tensor.dim() == 1:
                tensor.data += 0.3 * torch.rand(tensor.shape, generator=generator)
        return act

    return make


def plain(act, batch):
    """With gradients nothing is packed."""
    return act.act(batch, torch.zeros(len(batch["pose"]), act.config.latent)).detach().float()


@pytest.fixture
def made(monkeypatch):
    """How often a prediction was prepared."""
    times = []

    def make(*arguments):
        times.append(arguments)
        return PackedAct(*arguments)

    monkeypatch.setattr(_network, "PackedAct", make)
    return times


@pytest.mark.parametrize("options", CASES.values(), ids=CASES)
@pytest.mark.parametrize("features", FEATURES.values(), ids=FEATURES)
@pytest.mark.parametrize("rows", [1, 3])
def test_it_is_the_network_to_rounding(make_shaken_act, make_batch, made, options, features, rows):
    act, batch = make_shaken_act(features=features, **options), make_batch(rows, features=features)
    expected = plain(act, batch)
    found = act.predict(batch)
    assert len(made) == 1
    assert found.dtype == torch.float32
    assert not found.requires_grad
    torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-5)
    with torch.autocast("cpu", torch.bfloat16):
        low, plain_low = act.predict(batch), plain(act, batch)
    assert low.dtype == torch.float32
    assert not torch.equal(low, found)
    error, plain_error = ((x - expected).square().mean().sqrt() for x in (low, plain_low))
    assert error < 1.5 * plain_error + 1e-3


@pytest.mark.parametrize("mode", [torch.no_grad, torch.inference_mode, torch.enable_grad])
def test_every_mode_of_gradients_predicts_the_same(make_shaken_act, make_batch, mode):
    act, batch = make_shaken_act(), make_batch()
    with torch.inference_mode():
        expected = act.predict(batch).clone()
    with mode():
        assert torch.equal(act.predict(batch), expected)
        assert not act.predict(batch).requires_grad
    loss, _ = act.loss(batch)
    loss.backward()


def test_it_is_prepared_once_for_a_form(make_shaken_act, make_batch, made):
    act = make_shaken_act()
    for rows in (1, 1, 3, 3, 1):
        act.predict(make_batch(rows))
    assert len(made) == 3
    with torch.autocast("cpu", torch.bfloat16):
        act.predict(make_batch(1))
    assert len(made) == 4


def in_place(act, batch):
    with torch.no_grad():
        act.encoder.layers[1].linear2.weight.mul_(1.5)


def statistics(act, batch):
    act.trunk.layer3[0].bn1.running_var.mul_(1.5)


def positions(act, batch):
    act.query_position.data = act.query_position.data + 1.0


def loaded(act, batch):
    act.load_state_dict({name: 1.1 * tensor for name, tensor in act.state_dict().items()})


def optimised(act, batch):
    optimizer = torch.optim.SGD(act.parameters(), lr=0.05)
    act.loss(batch)[0].backward()
    optimizer.step()


@pytest.mark.parametrize("change", [in_place, statistics, positions, loaded, optimised])
def test_it_follows_the_weights(make_shaken_act, make_batch, change):
    act, batch = make_shaken_act(), make_batch()
    before = act.predict(batch)
    change(act, batch)
    after = act.predict(batch)
    assert not torch.allclose(after, before, rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(after, plain(act, batch), rtol=1e-5, atol=1e-5)


def test_copies_share_nothing(make_shaken_act, make_batch):
    act, batch = make_shaken_act(), make_batch()
    seen = act.predict(batch)
    for twin in (copy.deepcopy(act), pickle.loads(pickle.dumps(act))):
        assert torch.equal(twin.predict(batch), seen)
        with torch.no_grad():
            twin.action_head.bias.add_(1.0)
        torch.testing.assert_close(twin.predict(batch), seen + 1.0)
    assert torch.equal(act.predict(batch), seen)
    assert set(act.state_dict()) == set(copy.deepcopy(act).state_dict())


def test_what_cannot_be_packed_goes_the_plain_way(make_shaken_act, make_batch, made):
    grouped, batch = make_shaken_act(trunk_norm="group"), make_batch()
    torch.testing.assert_close(grouped.predict(batch), plain(grouped, batch), rtol=1e-5, atol=1e-5)
    double = make_shaken_act().double()
    batch = {
        name: tensor.double() if tensor.is_floating_point() else tensor for name, tensor in batch.items()
    }
    exact = double.act(batch, torch.zeros(3, 4, dtype=torch.float64)).detach()
    torch.testing.assert_close(double.predict(batch), exact.float(), rtol=1e-6, atol=1e-6)
    assert not made


def test_a_network_in_training_mode_drops_and_takes_the_batchs_statistics(make_shaken_act, make_batch, made):
    act, batch = make_shaken_act(dropout=0.5), make_batch()
    act.predict(batch)
    act.train()
    assert not torch.equal(act.predict(batch), act.predict(batch))
    assert len(made) == 1


def test_frozen_norms_are_folded_with_their_statistics(make_shaken_act):
    """Else the cases above would not tell a fold from none."""
    act = make_shaken_act(trunk_norm="frozen")
    norms = [module for module in act.trunk.modules() if isinstance(module, FrozenBatchNorm)]
    assert len(norms) == 20
    assert all((norm.running_var != 1.0).all() and norm.bias.all() for norm in norms)
