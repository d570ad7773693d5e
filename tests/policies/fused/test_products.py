"""Products in the orders that oneDNN likes, against plain ones."""

import pytest
import torch
from torch import nn
from torch.nn import functional

from geoprior.policies.fused.products import (
    contract,
    correlate,
    gradient_of_rows,
    gradient_of_weight,
    lay_out,
    product,
)


@pytest.mark.parametrize("shape", [(48, 16), (16, 48), (32, 32), (1, 9)])
def test_laying_out_moves_memory_and_no_number(shape):
    weight = nn.Parameter(torch.randn(shape))
    before = weight.detach().clone()
    assert lay_out(weight) is weight
    assert torch.equal(weight, before)
    longer = 0 if shape[0] > shape[1] else 1
    assert weight.stride(longer) == 1


@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
@pytest.mark.parametrize(("outputs", "inputs"), [(512, 640), (640, 512), (300, 2000), (96, 96)])
@pytest.mark.parametrize("rows", [7, 600, 640])
def test_products_and_their_gradients_are_those_of_a_linear_layer(rows, outputs, inputs, dtype):
    torch.manual_seed(0)
    x = torch.randn(rows, inputs).to(dtype)
    weight = lay_out((torch.randn(outputs, inputs) / inputs**0.5).to(dtype))
    gradient = torch.randn(rows, outputs).to(dtype)
    found = [product(x, weight), gradient_of_rows(gradient, weight), gradient_of_weight(gradient, x)]
    twins = [tensor.detach().double().requires_grad_() for tensor in (x, weight)]
    y = functional.linear(*twins)
    exact = [y, *torch.autograd.grad(y, twins, gradient.double())]
    tolerance = 2e-2 if dtype == torch.bfloat16 else 1e-5
    for ours, right in zip(found, exact, strict=True):
        assert ours.dtype == dtype
        assert (ours.double() - right).abs().max() < tolerance * right.abs().max()


def test_gradients_lie_as_weights_do():
    """An optimiser that goes through memory in order then needs no copy."""
    x = torch.randn(20, 16).to(torch.bfloat16)
    for shape in ((48, 16), (8, 16)):
        weight = lay_out(torch.randn(shape).to(torch.bfloat16))
        gradient = torch.randn(20, shape[0]).to(torch.bfloat16)
        assert gradient_of_weight(gradient, x).stride() == weight.stride()


def test_products_in_float32_are_torchs_to_the_bit():
    x, weight = torch.randn(9, 5), torch.randn(4, 5)
    assert torch.equal(product(x, weight), functional.linear(x, weight))


@pytest.mark.parametrize("rows", [511, 512, 700])
@pytest.mark.parametrize("columns", [256, 257, 512, 600])
def test_cutting_a_product_changes_no_sum(rows, columns):
    x, weight = torch.randn(rows, 64).to(torch.bfloat16), torch.randn(columns, 64).to(torch.bfloat16)
    exact = x.double() @ weight.double().t()
    assert ((contract(x, weight).double() - exact).abs() <= 2**-8 * exact.abs() + 1e-6).all()


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32, torch.bfloat16])
@pytest.mark.parametrize("rows", [1, 33, 216])
@pytest.mark.parametrize("columns", [65, 1700])
def test_correlating(rows, columns, dtype):
    small, large = torch.randn(rows, 31).to(dtype), torch.randn(rows, columns).to(dtype)
    exact = small.double().t() @ large.double()
    tolerance = 1e-2 if dtype == torch.bfloat16 else 1e-4
    torch.testing.assert_close(correlate(small, large).double(), exact, rtol=tolerance, atol=tolerance * 10)
