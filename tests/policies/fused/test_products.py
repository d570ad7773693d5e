"""Products in the orders that oneDNN likes, against plain ones."""

import pytest
import torch
from torch import nn
from torch.nn import functional

from geoprior.policies.fused.products import contract, correlate, lay_out, linear


@pytest.mark.parametrize("shape", [(48, 16), (16, 48), (32, 32), (1, 9)])
def test_laying_out_moves_memory_and_no_number(shape):
    weight = nn.Parameter(torch.randn(shape))
    before = weight.detach().clone()
    assert lay_out(weight) is weight
    assert torch.equal(weight, before)
    longer = 0 if shape[0] > shape[1] else 1
    assert weight.stride(longer) == 1


@pytest.mark.parametrize(("outputs", "inputs"), [(512, 640), (640, 512), (300, 2000), (96, 96)])
@pytest.mark.parametrize("batch", [(7,), (8, 80), (600,)])
def test_linear_under_autocast_is_torchs(batch, outputs, inputs):
    torch.manual_seed(0)
    x = torch.randn(*batch, inputs, requires_grad=True)
    weight = lay_out(nn.Parameter(torch.randn(outputs, inputs) / inputs**0.5))
    gradient = torch.randn(*batch, outputs)
    found = []
    for function in (linear, functional.linear):
        with torch.autocast("cpu", torch.bfloat16):
            y = function(x, weight)
        assert y.dtype == torch.bfloat16
        found.append([y, *torch.autograd.grad(y, [x, weight], gradient.to(y.dtype))])
    for ours, torchs in zip(*found, strict=True):
        assert ours.shape == torchs.shape
        assert ours.dtype == torchs.dtype
        torch.testing.assert_close(
            ours.float(), torchs.float(), rtol=2e-2, atol=2e-2 * torchs.abs().max().item()
        )


def test_gradients_lie_as_weights_do():
    """An optimiser that goes through memory in order then needs no copy."""
    x = torch.randn(20, 16).to(torch.bfloat16)
    for shape in ((48, 16), (8, 16)):
        weight = lay_out(nn.Parameter(torch.randn(shape).to(torch.bfloat16)))
        linear(x, weight).sum().backward()
        assert weight.grad.stride() == weight.stride()


def test_linear_in_float32_is_torchs_to_the_bit():
    x, weight = torch.randn(9, 5), torch.randn(4, 5)
    assert torch.equal(linear(x, weight), functional.linear(x, weight))


@pytest.mark.parametrize("rows", [511, 512, 700])
@pytest.mark.parametrize("columns", [256, 257, 512, 600])
def test_cutting_a_product_changes_no_sum(rows, columns):
    x, weight = torch.randn(rows, 64).to(torch.bfloat16), torch.randn(columns, 64).to(torch.bfloat16)
    exact = x.double() @ weight.double().t()
    assert ((contract(x, weight).double() - exact).abs() <= 2**-8 * exact.abs() + 1e-6).all()


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32, torch.bfloat16])
@pytest.mark.parametrize("rows", [1, 33, 200])
def test_correlating(rows, dtype):
    small, large = torch.randn(rows, 31).to(dtype), torch.randn(rows, 65).to(dtype)
    exact = small.double().t() @ large.double()
    tolerance = 1e-2 if dtype == torch.bfloat16 else 1e-4
    torch.testing.assert_close(correlate(small, large).double(), exact, rtol=tolerance, atol=tolerance * 10)
