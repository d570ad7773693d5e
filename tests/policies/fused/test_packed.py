"""Weights in oneDNN's layout: the same products."""

import pytest
import torch
from torch.nn import functional

from geoprior.policies.fused.packed import (
    PackedConvolution,
    PackedLinear,
    UnfoldedConvolution,
    is_packable,
    pack_convolution,
)

TYPES = {torch.float32: 1e-4, torch.bfloat16: 3e-2}


@pytest.fixture(params=TYPES, ids=lambda dtype: str(dtype).removeprefix("torch."))
def dtype(request):
    torch.manual_seed(0)
    return request.param


@pytest.mark.parametrize("rows", [1, 20, 300])
@pytest.mark.parametrize("biased", [False, True])
@pytest.mark.parametrize("turned", [False, True])
def test_what_follows_a_product_is_part_of_it(rows, biased, turned, dtype):
    weight, bias = (torch.randn(48, 64) / 8.0).to(dtype), torch.randn(48).to(dtype)
    weight = weight.t().contiguous().t() if turned else weight
    x, other = torch.randn(rows, 64).to(dtype), torch.randn(rows, 48).to(dtype)
    exact = x.double() @ weight.double().t() + (bias.double() if biased else 0.0)
    with torch.no_grad():
        linear = PackedLinear(weight, bias if biased else None, 20, dtype)
        found = (linear(x), linear.relu(x), linear.plus(x, other))
    for one, expected in zip(found, (exact, exact.relu(), exact + other.double()), strict=True):
        assert one.dtype == dtype
        torch.testing.assert_close(one.double(), expected, rtol=TYPES[dtype], atol=TYPES[dtype])


@pytest.mark.parametrize(("kernel", "stride"), [(1, 1), (1, 2), (3, 1), (3, 2), (7, 2)])
@pytest.mark.parametrize("form", [PackedConvolution, UnfoldedConvolution])
def test_convolution_is_torchs(kernel, stride, form, dtype):
    x = torch.randn(2, 8, 9, 6).to(dtype).to(memory_format=torch.channels_last)
    weight = (torch.randn(16, 8, kernel, kernel) / (8 * kernel**2) ** 0.5).to(dtype)
    bias = torch.randn(16).to(dtype)
    exact = functional.conv2d(x.double(), weight.double(), bias.double(), stride, kernel // 2)
    other = torch.randn(exact.shape).to(dtype).to(memory_format=torch.channels_last)
    with torch.no_grad():
        convolution = form(weight, bias, stride, x.shape, dtype)
        found = (convolution(x), convolution.relu(x), convolution.plus_relu(x, other))
    for one, expected in zip(found, (exact, exact.relu(), (exact + other.double()).relu()), strict=True):
        assert one.dtype == dtype
        torch.testing.assert_close(one.double(), expected, rtol=TYPES[dtype], atol=TYPES[dtype])


@pytest.mark.parametrize("size", [(6, 2), (6, 1), (80, 2), (2, 6), (1, 1)])
def test_maps_of_one_column(size, dtype):
    """oneDNN of torch 2.13 has other numbers, and infinite ones, for some of these in bfloat16."""
    x = torch.randn(9, 64, *size).to(dtype).to(memory_format=torch.channels_last)
    weight, bias = (torch.randn(128, 64, 3, 3) / 24.0).to(dtype), torch.randn(128).to(dtype)
    exact = functional.conv2d(x.double(), weight.double(), bias.double(), 2, 1)
    with torch.no_grad():
        found = pack_convolution(weight, bias, 2, x.shape, dtype)(x)
    torch.testing.assert_close(found.double(), exact, rtol=TYPES[dtype], atol=TYPES[dtype])


def test_nothing_is_packed_while_something_is_learned():
    x = torch.randn(2, 3)
    assert not is_packable(x)
    with torch.no_grad():
        assert is_packable(x)
        assert not is_packable(x.double())
        with torch.autocast("cpu", torch.float16):
            assert not is_packable(x)
