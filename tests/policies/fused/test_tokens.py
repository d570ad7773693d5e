"""Passes over tokens, against torch's operators in float64, and their dropout."""

import numpy as np
import pytest
import torch
from torch import nn
from torch.nn import functional

from geoprior.policies.fused import tokens
from geoprior.policies.fused._kernels import exponentiate
from geoprior.policies.fused.tokens import Heads, Normed, draw_dropout

TYPES = {torch.float32: 1e-5, torch.bfloat16: 1.5e-2}
SHARE = 26 / 256


@pytest.fixture(params=TYPES, ids=lambda dtype: str(dtype).removeprefix("torch."))
def dtype(request):
    torch.manual_seed(0)
    return request.param


class Node(torch.autograd.Function):
    """A pass and the pass of its gradient: ``forth(*tensors)`` gives a value and what ``back`` remembers."""

    @staticmethod
    def forward(ctx, forth, back, *tensors):
        y, ctx.remembered = forth(*tensors)
        ctx.back = back
        return y

    @staticmethod
    def backward(ctx, gradient):
        return None, None, *ctx.back(gradient.contiguous(), ctx.remembered)


def add_norm(x, branch, bias, norm, probability, *, training):
    if x.dtype == torch.float64:
        return norm(x + functional.dropout(branch + bias, probability, training))
    dropout = draw_dropout(probability, training=training)

    def forth(x, branch, bias, weight, shift):
        rows = (tensor.view(-1, tensor.shape[-1]) for tensor in (x, branch))
        y, normed = tokens.add_norm(*rows, bias, (weight, shift, norm.eps), dropout)
        return y.view(x.shape), normed

    def back(gradient, normed):
        rows = gradient.view(-1, gradient.shape[-1])
        of_x, of_branch, totals = tokens.add_norm_back(rows, Normed(*normed), norm.weight, dropout)
        weight, shift, bias = totals
        return of_x.view(gradient.shape), of_branch.view(gradient.shape), bias, weight, shift

    return Node.apply(forth, back, x, branch, bias, norm.weight, norm.bias)


def relu_drop(x, bias, probability, *, training):
    if x.dtype == torch.float64:
        return functional.dropout(functional.relu(x + bias), probability, training)
    dropout = draw_dropout(probability, training=training)

    def forth(x, bias):
        y = tokens.relu_drop(x.view(-1, x.shape[-1]), bias, dropout)
        return y.view(x.shape), y

    def back(gradient, y):
        of_x, of_bias = tokens.relu_drop_back(gradient.view(y.shape), y, dropout)
        return of_x.view(gradient.shape), of_bias

    return Node.apply(forth, back, x, bias)


def attention_weights(scores, mask, scale, probability, *, training):
    if scores.dtype == torch.float64:
        scores = scores * scale
        if mask is not None:
            scores = scores.masked_fill(~mask[:, None, None, :], -torch.inf)
        return functional.dropout(scores.softmax(-1), probability, training)
    dropout = draw_dropout(probability, training=training)

    def forth(scores):
        weights, kept = tokens.softmax_drop(scores.flatten(0, 1), mask, scale, dropout)
        return kept.view(scores.shape), weights

    def back(gradient, weights):
        slabs = gradient.view(weights.shape)
        return (tokens.softmax_drop_back(slabs, weights, scale, dropout).view(gradient.shape),)

    return Node.apply(forth, back, scores)


def split_heads(projected, bias, tokens_count, heads):
    """(parts, B, heads, T, n)."""
    if projected.dtype == torch.float64:
        parts = projected.view(
            -1, tokens_count, heads.parts, heads.number, bias.numel() // (heads.parts * heads.number)
        )
        moves = parts[-1].clone()
        moves[:, heads.moved :] = 0.0
        return (parts[:-1] + moves + bias.view(parts.shape[2:])).permute(2, 0, 3, 1, 4)

    def forth(projected, bias):
        split = tokens.split_heads(projected, bias, tokens_count, heads)
        return split.view(heads.parts, -1, heads.number, *split.shape[2:]), None

    def back(gradient, _):
        return tokens.join_heads(gradient.flatten(1, 2), heads)

    return Node.apply(forth, back, projected, bias)


def drawn(*shape, dtype):
    return torch.randn(shape).to(dtype).requires_grad_()


def both(function, inputs, dtype):
    """Values and gradients of a function on the inputs and on their float64 twins; the twin is not fused."""
    found = []
    for exact in (False, True):
        given = [x.detach().double().requires_grad_() if exact else x for x in inputs]
        y = function(*given)
        torch.manual_seed(5)
        gradient = torch.randn(y.shape).to(dtype)
        found.append([y, *torch.autograd.grad(y, given, gradient.to(y.dtype))])
    return found


def assert_same(function, inputs, dtype):
    for ours, exact in zip(*both(function, inputs, dtype), strict=True):
        scale = exact.abs().max()
        assert (ours.double() - exact).abs().max() < TYPES[dtype] * scale * (1 if ours.dtype == dtype else 2)


class Norm(nn.Module):
    """A layer norm of given tensors."""

    eps = 1e-5

    def __init__(self, weight, bias):
        super().__init__()
        self.weight, self.bias = weight, bias

    def forward(self, x):
        return functional.layer_norm(x, self.weight.shape, self.weight, self.bias, self.eps)


@pytest.mark.parametrize("shape", [(3, 5, 12), (200, 64), (2, 1, 7)])
def test_add_norm(shape, dtype):
    def function(x, branch, bias, weight, shift):
        return add_norm(x, branch, bias, Norm(weight, shift), 0.5, training=False)

    small = [torch.randn(shape[-1]).requires_grad_() for _ in range(3)]
    assert_same(function, [drawn(*shape, dtype=dtype), drawn(*shape, dtype=dtype), *small], dtype)


@pytest.mark.parametrize("shape", [(3, 5, 12), (200, 64)])
def test_relu_drop(shape, dtype):
    bias = torch.randn(shape[-1]).requires_grad_()
    assert_same(lambda x, b: relu_drop(x, b, 0.5, training=False), [drawn(*shape, dtype=dtype), bias], dtype)


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize(("queries", "keys"), [(4, 4), (3, 27), (1, 9)])
def test_attention_weights(queries, keys, masked, dtype):
    mask = torch.rand(5, keys) < 0.6
    mask[:, 0] = True
    mask = mask if masked else None
    scores = drawn(5, 2, queries, keys, dtype=dtype)
    assert_same(lambda x: attention_weights(x, mask, 0.3, 0.5, training=False), [scores], dtype)
    weights = attention_weights(scores, mask, 0.3, 0.5, training=False)
    if masked:
        hidden = ~mask[:, None, None, :].expand_as(weights)
        assert (weights[hidden] == 0).all()


@pytest.mark.parametrize("heads", [Heads(3, 2, 2), Heads(1, 1, 4), Heads(2, 1, 8)])
@pytest.mark.parametrize(("batch", "count"), [(3, 5), (9, 1), (1, 20)])
def test_split_heads(batch, count, heads, dtype):
    dim = 8 * heads.number
    rows = drawn((batch + 1) * count, heads.parts * dim, dtype=dtype)
    bias = torch.randn(heads.parts * dim).requires_grad_()
    assert_same(lambda x, b: split_heads(x, b, count, heads), [rows, bias], dtype)
    split = split_heads(rows, torch.zeros(heads.parts * dim), count, heads)
    samples, moves = rows[: batch * count].view(batch, count, -1), rows[batch * count :]
    together = (samples.float() + moves.float()).chunk(heads.parts, -1)
    still = samples.float().chunk(heads.parts, -1)
    for part in range(heads.parts):
        expected = together[part] if part < heads.moved else still[part]
        found = split[part].transpose(1, 2).flatten(2).float()
        torch.testing.assert_close(found, expected, rtol=1e-2, atol=1e-2)


def drop_in_add_norm(x, training):
    """The dropout alone: a norm hides it, the gradient of the branch shows it."""
    branch = torch.zeros_like(x).requires_grad_()
    y = add_norm(x, branch, torch.zeros(x.shape[-1]), nn.LayerNorm(x.shape[-1]), 0.1, training=training)
    (of_x, of_branch) = torch.autograd.grad(y, [x, branch], torch.randn(y.shape, dtype=y.dtype))
    return (of_branch / of_x).float()


def drop_in_relu(x, training):
    return relu_drop(torch.ones_like(x), torch.zeros(x.shape[-1]), 0.1, training=training).float()


def drop_in_attention(x, training):
    scores = torch.zeros_like(x).view(4, 2, -1, x.shape[-1])
    return attention_weights(scores, None, 1.0, 0.1, training=training).float() * x.shape[-1]


DROPS = [drop_in_add_norm, drop_in_relu, drop_in_attention]


@pytest.mark.parametrize("drop", DROPS)
@pytest.mark.parametrize("width", [509, 512])
def test_dropout_drops_the_rounded_share_at_random_and_keeps_the_expectation(drop, width, dtype):
    factors = drop(drawn(800, width, dtype=dtype), training=True).flatten()
    kept = factors > 0.5
    assert kept.float().mean() == pytest.approx(1 - SHARE, abs=0.004)
    torch.testing.assert_close(
        factors[kept], torch.full_like(factors[kept], 1 / (1 - SHARE)), rtol=2e-2, atol=0.0
    )
    for lag in (1, 2, 7, 8, width):
        both_kept = (kept[lag:] & kept[:-lag]).float().mean()
        assert both_kept == pytest.approx((1 - SHARE) ** 2, abs=0.006)


@pytest.mark.parametrize("drop", DROPS)
def test_dropout_follows_torchs_seed_and_rests_outside_training(drop, dtype):
    x = drawn(80, 64, dtype=dtype)
    seen = []
    for seed in (3, 3, 4):
        torch.manual_seed(seed)
        seen.append(drop(x, training=True) > 0.5)
    assert torch.equal(seen[0], seen[1])
    assert not torch.equal(seen[0], seen[2])
    assert (drop(x, training=False) > 0.5).all()


def test_the_gradient_passes_where_the_value_did(dtype):
    x, bias = drawn(64, 40, dtype=dtype), torch.randn(40)
    y = relu_drop(x, bias, 0.5, training=True)
    (gradient,) = torch.autograd.grad(y, x, torch.ones_like(y))
    assert torch.equal(gradient > 0, y > 0)
    torch.testing.assert_close(gradient[gradient > 0].float(), torch.full_like(y[y > 0], 2.0).float())
    scores = drawn(2, 2, 6, 10, dtype=torch.float32)
    torch.manual_seed(1)
    weights = attention_weights(scores, None, 1.0, 0.5, training=True)
    kept = (weights > 0).double() * 2.0
    twin = scores.detach().double().requires_grad_()
    downstream = torch.randn(weights.shape)
    (found,) = torch.autograd.grad(weights, scores, downstream)
    (expected,) = torch.autograd.grad(twin.softmax(-1) * kept, twin, downstream.double())
    torch.testing.assert_close(found.double(), expected, atol=1e-6, rtol=1e-5)


def test_results_do_not_depend_on_the_number_of_threads(dtype, monkeypatch):
    x, branch, bias = drawn(3000, 64, dtype=dtype), drawn(3000, 64, dtype=dtype), torch.randn(64)
    bias.requires_grad_()
    norm = nn.LayerNorm(64)

    def results():
        torch.manual_seed(7)
        y = add_norm(x, relu_drop(branch, bias, 0.1, training=True), bias, norm, 0.1, training=True)
        return [y, *torch.autograd.grad(y, [x, branch, bias, norm.weight], torch.ones_like(y))]

    found = results()
    monkeypatch.setattr(tokens, "in_lanes", lambda kernel, _, *arguments: kernel(1, *arguments))
    assert all(torch.equal(ours, alone) for ours, alone in zip(found, results(), strict=True))


def test_a_query_that_sees_nothing_is_nan_as_in_torch(dtype):
    mask = torch.zeros(1, 4, dtype=torch.bool)
    weights = attention_weights(torch.zeros(1, 1, 2, 4, dtype=dtype), mask, 1.0, 0.0, training=False)
    assert weights.isnan().all()
    assert functional.softmax(torch.full((4,), -torch.inf), dim=0).isnan().all()


def test_exponentials_below_zero():
    x = np.linspace(-86.9, 0.0, 1_000_001).astype(np.float32)
    found = x.copy()
    exponentiate(found)
    exact = np.exp(x.astype(np.float64))
    assert np.abs(found / exact - 1.0).max() < 2.0**-22
    assert (np.diff(found) >= -(2.0**-22) * found[1:]).all()
    edges = np.array([0.0, -np.inf, -1e30, np.nan], np.float32)
    exponentiate(edges)
    np.testing.assert_array_equal(edges, [1.0, 0.0, 0.0, np.nan])
