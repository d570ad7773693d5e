"""ACT as a whole: what its loss counts and what its prediction depends on."""

import pytest
import torch
from pydantic import ValidationError
from torch.distributions import Normal, kl_divergence
from torch.nn import functional

from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.act.plugin import ActConfig
from geoprior.policies.policy import Features


def seeded_loss(act, batch):
    torch.manual_seed(7)
    return act.loss(batch)


def test_shapes_follow_the_features(make_act, make_batch):
    features = Features(cameras=("a", "b", "c"), image_size=(33, 70), hands=("left", "right"), chunk=9)
    act = make_act(features=features).eval()
    batch = make_batch(2, features=features)
    assert act.predict(batch).shape == (2, 9, 16)
    assert [part.shape for part in act.encode_style(batch)] == [(2, 4), (2, 4)]
    loss, scalars = act.loss(batch)
    assert loss.shape == ()
    assert set(scalars) == {"loss", "l1", "kl"}
    assert not any(scalar.requires_grad for scalar in scalars.values())


def test_the_loss_does_not_see_padded_actions(make_act, make_batch):
    act, batch = make_act().eval(), make_batch()
    before, scalars = seeded_loss(act, batch)
    batch["action"] = torch.where(batch["valid"].unsqueeze(-1), batch["action"], torch.tensor(99.0))
    after, others = seeded_loss(act, batch)
    torch.testing.assert_close(after, before)
    torch.testing.assert_close(others["kl"], scalars["kl"])
    batch["action"][0, 0] += 1.0
    assert not torch.isclose(seeded_loss(act, batch)[0], before)


def test_kl_is_that_of_torch_distributions(make_act, make_batch):
    act, batch = make_act().eval(), make_batch()
    mean, log_variance = act.encode_style(batch)
    style = Normal(mean, (0.5 * log_variance).exp())
    expected = kl_divergence(style, Normal(torch.zeros(()), torch.ones(()))).sum(-1).mean()
    total, scalars = act.loss(batch)
    torch.testing.assert_close(scalars["kl"], expected)
    torch.testing.assert_close(total, scalars["l1"] + 10.0 * expected)


@pytest.mark.parametrize("padding", ["valid", "all"])
def test_both_conventions_of_padding(make_act, make_batch, padding):
    act, batch = make_act(padding=padding).eval(), make_batch()
    torch.manual_seed(7)
    mean, log_variance = act.encode_style(batch)
    actions = act.act(batch, mean + (0.5 * log_variance).exp() * torch.randn_like(mean))
    error = functional.l1_loss(actions, batch["action"], reduction="none")
    if padding == "valid":
        expected = error[batch["valid"]].mean()
    else:
        expected = (error * batch["valid"].unsqueeze(-1)).mean()
    torch.testing.assert_close(seeded_loss(act, batch)[1]["l1"], expected)


def test_prediction_has_neither_style_nor_randomness_nor_gradient(make_act, make_batch):
    act, batch = make_act().eval(), make_batch()
    predicted = act.predict(batch)
    assert torch.equal(predicted, act.predict(batch))
    assert not predicted.requires_grad
    torch.testing.assert_close(predicted, act.act(batch, torch.zeros(3, 4)))
    for name in ("action", "valid"):
        del batch[name]
    assert torch.equal(predicted, act.predict(batch))


def test_cameras_are_a_set(make_act, make_batch):
    """As in LeRobot's ACT, no embedding says which camera a token came from."""
    act, batch = make_act().eval(), make_batch()
    predicted = act.predict(batch)
    swapped = act.predict({**batch, "images": batch["images"].flip(1)})
    torch.testing.assert_close(swapped, predicted, atol=1e-5, rtol=1e-4)
    mirrored = act.predict({**batch, "images": batch["images"].flip(-1)})
    assert not torch.allclose(mirrored, predicted, atol=1e-4)


def test_batches_are_equivariant(make_act, make_batch):
    act, batch = make_act().eval(), make_batch()
    turned = {name: tensor.flip(0) for name, tensor in batch.items()}
    torch.testing.assert_close(act.predict(turned), act.predict(batch).flip(0), atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("norm", ["batch", "group"])
def test_every_weight_learns(make_act, make_batch, norm):
    """But three: the decoder's queries begin as zeros, so its first self-attention has nothing to mix."""
    act, batch = make_act(trunk_norm=norm, dropout=0.0).train(), make_batch()
    act.loss(batch)[0].backward()
    still = [name for name, weight in act.named_parameters() if weight.grad is None or not weight.grad.any()]
    first = "decoder.layers.0"
    inert = {
        f"{first}.self_attn.in_proj_weight",
        f"{first}.self_attn.out_proj.weight",
        f"{first}.norm1.weight",
    }
    assert set(still) == inert


def test_bf16_stays_near_fp32(make_act, make_batch):
    act, batch = make_act().eval(), make_batch()
    with torch.autocast("cpu", torch.bfloat16):
        low, _ = seeded_loss(act, batch)
    high, _ = seeded_loss(act, batch)
    assert low.dtype == torch.float32
    torch.testing.assert_close(low, high, rtol=0.05, atol=0.05)


def test_the_trunk_prefix_covers_the_trunk_and_nothing_else(make_act):
    act = make_act()
    covered = {name for name in act.state_dict() if name.startswith(act.trunk_prefixes)}
    assert covered == {f"trunk.{name}" for name in act.trunk.state_dict()}


def test_it_is_registered_and_checks_its_options():
    features = Features(("hand",), (32, 32), ("hand",), 6)
    options = {"chunk": 6, "dim": 8, "heads": 2, "ffn": 8, "trunk_width": 8}
    act = plugins().build("policy", Choice(name="act", options=options), features)
    assert act.features is features
    with pytest.raises(ValidationError, match="heads 3 must divide dim 256"):
        ActConfig(heads=3)
