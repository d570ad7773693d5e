"""Passes over feature maps, against torch's operators in float64."""

import copy

import pytest
import torch
from torch import nn
from torch.nn import functional

from geoprior.policies.fused import maps
from geoprior.policies.fused.maps import affine_relu, affine_relu_pool, batch_norm_relu, batch_norm_relu_pool

SHAPES = [(2, 8, 3, 5), (5, 8, 1, 1), (3, 1, 4, 4), (3, 64, 6, 6), (1, 24, 7, 1), (16, 32, 12, 12)]
TYPES = {torch.float32: 1e-5, torch.bfloat16: 2e-2}


@pytest.fixture(params=TYPES, ids=lambda dtype: str(dtype).removeprefix("torch."))
def dtype(request):
    return request.param


@pytest.fixture(params=SHAPES, ids=str)
def shape(request):
    torch.manual_seed(0)
    return request.param


def drawn(shape, dtype):
    """Numbers that the type holds exactly, channels last in memory."""
    x = torch.randn(shape).to(dtype)
    return x.to(memory_format=torch.channels_last) if len(shape) == 4 else x


def gradients_of(y, gradient, *inputs):
    return torch.autograd.grad(y, inputs, gradient.to(y.dtype), retain_graph=True)


def assert_near(found, exact, dtype):
    """To the type's precision, of the largest number; a ReLU near zero may fall on either side of it."""
    assert found.dtype == dtype
    error = (found.double() - exact).abs()
    scale = exact.abs().max() + 1e-6
    assert error.quantile(0.99) < TYPES[dtype] * scale
    assert error.mean() < 0.2 * TYPES[dtype] * scale


@pytest.mark.parametrize("added", [False, True])
def test_affine_relu(shape, dtype, added):
    x, gradient = drawn(shape, dtype).requires_grad_(), drawn(shape, dtype)
    residual = drawn(shape, dtype).requires_grad_() if added else None
    scale, shift = torch.randn(shape[1]), torch.randn(shape[1])
    inputs = [x, residual] if added else [x]
    y = affine_relu(x, scale, shift, residual)
    exact_inputs = [tensor.detach().double().requires_grad_() for tensor in inputs]
    by_channel = [number.double()[:, None, None] for number in (scale, shift)]
    exact = functional.relu(exact_inputs[0] * by_channel[0] + by_channel[1] + sum(exact_inputs[1:]))
    assert_near(y, exact, dtype)
    expected = gradients_of(exact, gradient, *exact_inputs)
    for found, truth in zip(gradients_of(y, gradient, *inputs), expected, strict=True):
        assert_near(found, truth, dtype)


@pytest.mark.parametrize("added", [False, True])
def test_batch_norm_relu_and_its_running_statistics(shape, dtype, added):
    x, gradient = 3.0 + drawn(shape, dtype), drawn(shape, dtype)
    x.requires_grad_()
    residual = drawn(shape, dtype).requires_grad_() if added else None
    norm = nn.BatchNorm2d(shape[1]).train()
    nn.init.uniform_(norm.weight, 0.5, 2.0)
    nn.init.normal_(norm.bias)
    exact_norm = copy.deepcopy(norm).double()
    inputs = [x, residual] if added else [x]
    y = batch_norm_relu(x, norm, residual)
    exact_inputs = [tensor.detach().double().requires_grad_() for tensor in inputs]
    exact = functional.relu(exact_norm(exact_inputs[0]) + sum(exact_inputs[1:]))
    assert_near(y, exact, dtype)
    expected = gradients_of(exact, gradient, *exact_inputs, exact_norm.weight, exact_norm.bias)
    found = gradients_of(y, gradient, *inputs, norm.weight, norm.bias)
    for ours, truth in zip(found, expected, strict=True):
        # A ReLU that falls on the other side weighs more in a sum over a channel than in a map.
        error = (ours.double() - truth).abs().quantile(0.9)
        assert error < (2.0 if ours.dim() == 4 else 5.0) * TYPES[dtype] * truth.abs().max()
    for name in ("running_mean", "running_var"):
        torch.testing.assert_close(
            getattr(norm, name).double(), getattr(exact_norm, name), rtol=1e-5, atol=1e-6
        )
    assert norm.num_batches_tracked == exact_norm.num_batches_tracked == 1


def test_a_variance_that_is_small_beside_the_mean_is_not_lost():
    x = (1000.0 + torch.randn(8, 8, 12, 12)).to(memory_format=torch.channels_last)
    norm = nn.BatchNorm2d(8).train()
    y = batch_norm_relu(x, norm)
    exact = functional.relu(nn.BatchNorm2d(8).double().train()(x.double()))
    torch.testing.assert_close(y.double(), exact, atol=1e-3, rtol=1e-3)


POOLED = [(6, 6), (7, 9), (1, 1), (2, 5), (12, 12)]


@pytest.mark.parametrize("size", POOLED)
def test_affine_relu_pool(size, dtype):
    torch.manual_seed(1)
    x = drawn((3, 16, *size), dtype).requires_grad_()
    scale, shift = torch.randn(16), torch.randn(16)
    y = affine_relu_pool(x, scale, shift)
    twin = x.detach().double().requires_grad_()
    by_channel = [number.double()[:, None, None] for number in (scale, shift)]
    exact = functional.max_pool2d(functional.relu(twin * by_channel[0] + by_channel[1]), 3, 2, 1)
    assert_near(y, exact, dtype)
    gradient = drawn(y.shape, dtype)
    (expected,) = gradients_of(exact, gradient, twin)
    (found,) = gradients_of(y, gradient, x)
    torch.testing.assert_close(found.double(), expected, rtol=TYPES[dtype], atol=TYPES[dtype])


@pytest.mark.parametrize("size", POOLED)
def test_batch_norm_relu_pool(size, dtype):
    torch.manual_seed(1)
    x = (3.0 + drawn((5, 16, *size), dtype)).requires_grad_()
    norm = nn.BatchNorm2d(16).train()
    nn.init.uniform_(norm.weight, -2.0, 2.0)
    nn.init.normal_(norm.bias)
    exact_norm = copy.deepcopy(norm).double()
    y = batch_norm_relu_pool(x, norm)
    twin = x.detach().double().requires_grad_()
    exact = functional.max_pool2d(functional.relu(exact_norm(twin)), 3, 2, 1)
    assert_near(y, exact, dtype)
    gradient = drawn(y.shape, dtype)
    expected = gradients_of(exact, gradient, twin, exact_norm.weight, exact_norm.bias)
    found = gradients_of(y, gradient, x, norm.weight, norm.bias)
    for ours, truth in zip(found, expected, strict=True):
        error = (ours.double() - truth).abs().max()
        assert error < 5.0 * TYPES[dtype] * truth.abs().max()
    torch.testing.assert_close(norm.running_var.double(), exact_norm.running_var, rtol=1e-5, atol=1e-6)


def test_what_is_not_finite_stays_so(dtype):
    x = drawn((2, 8, 4, 4), dtype)
    x[0, 3, 1, 1] = torch.nan
    assert affine_relu(x, torch.ones(8), torch.zeros(8))[0, 3, 1, 1].isnan()
    assert affine_relu_pool(x, torch.ones(8), torch.zeros(8))[0, 3, 0, 0].isnan()
    assert batch_norm_relu(x, nn.BatchNorm2d(8).train())[:, 3].isnan().all()


@pytest.mark.parametrize("threads", [1, 2])
def test_results_do_not_depend_on_the_number_of_threads(threads, dtype, monkeypatch):
    """Many rows, so that lanes are really shared."""
    torch.manual_seed(2)
    x, gradient = drawn((16, 32, 24, 24), dtype).requires_grad_(), drawn((16, 32, 12, 12), dtype)
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        norm = nn.BatchNorm2d(32).train()
        y = batch_norm_relu_pool(batch_norm_relu(x, nn.BatchNorm2d(32).train()), norm)
        found = [y, *gradients_of(y, gradient, x, norm.weight, norm.bias), norm.running_var]
    finally:
        torch.set_num_threads(before)
    monkeypatch.setattr(maps, "in_lanes", lambda kernel, _, *arguments: kernel(1, *arguments))
    norm = nn.BatchNorm2d(32).train()
    y = batch_norm_relu_pool(batch_norm_relu(x, nn.BatchNorm2d(32).train()), norm)
    expected = [y, *gradients_of(y, gradient, x, norm.weight, norm.bias), norm.running_var]
    assert all(torch.equal(ours, alone) for ours, alone in zip(found, expected, strict=True))
