"""Weights in oneDNN's layout: the same products, and never those of yesterday's weights."""

import copy

import pytest
import torch
from torch import nn
from torch.nn import functional

from geoprior.policies.fused import packed
from geoprior.policies.fused.packed import is_packable, pack_kernel, packed_convolution, packed_linear
from geoprior.policies.trunk import Convolution, FrozenBatchNorm, ResNet18

TYPES = {torch.float32: 1e-4, torch.bfloat16: 3e-2}


@pytest.fixture(params=TYPES, ids=lambda dtype: str(dtype).removeprefix("torch."))
def dtype(request):
    torch.manual_seed(0)
    return request.param


@pytest.mark.parametrize("rows", [1, 20, 300])
@pytest.mark.parametrize("turned", [False, True])
def test_linear_is_torchs(rows, turned, dtype):
    weight = (torch.randn(48, 64) / 8.0).to(dtype)
    weight = weight.t().contiguous().t() if turned else weight
    x = torch.randn(rows, 64).to(dtype)
    with torch.no_grad():
        found = packed_linear(x, weight)
        assert torch.equal(found, packed_linear(x, weight))
    exact = x.double() @ weight.double().t()
    torch.testing.assert_close(found.double(), exact, rtol=TYPES[dtype], atol=TYPES[dtype])


def test_a_weight_that_is_written_to_is_laid_out_anew(dtype):
    weight, x = torch.randn(16, 32).to(dtype), torch.randn(4, 32).to(dtype)
    with torch.no_grad():
        before = packed_linear(x, weight)
        weight.mul_(2.0)
        torch.testing.assert_close(packed_linear(x, weight), 2.0 * before, rtol=1e-2, atol=1e-2)
        for rows in (9, 4):  # for other numbers of rows too
            assert packed_linear(x[:1].expand(rows, -1).contiguous(), weight).shape == (rows, 16)


def test_what_was_laid_out_goes_with_its_weight():
    before = len(packed._kept)
    weight = torch.randn(16, 32)
    with torch.no_grad():
        packed_linear(torch.randn(2, 32), weight)
    assert len(packed._kept) == before + 1
    del weight
    assert len(packed._kept) == before


@pytest.mark.parametrize(("kernel", "stride"), [(1, 2), (3, 1), (3, 2), (7, 2)])
@pytest.mark.parametrize("form", ["none", "relu", "residual"])
def test_convolution_is_torchs(kernel, stride, form, dtype):
    x = torch.randn(2, 8, 9, 6).to(dtype).to(memory_format=torch.channels_last)
    weight = (torch.randn(16, 8, kernel, kernel) / (8 * kernel**2) ** 0.5).to(dtype)
    bias = torch.randn(16).to(dtype)
    expected = functional.conv2d(x.double(), weight.double(), bias.double(), stride, kernel // 2)
    residual = torch.randn(expected.shape).to(dtype).to(memory_format=torch.channels_last)
    if form == "residual":
        expected = expected + residual.double()
    expected = expected if form == "none" else functional.relu(expected)
    with torch.no_grad():
        laid_out = pack_kernel(weight, stride, x.shape)
        found = packed_convolution(
            x,
            laid_out,
            bias,
            kernel,
            stride,
            relu=form != "none",
            residual=residual if form == "residual" else None,
        )
    torch.testing.assert_close(found.double(), expected, rtol=TYPES[dtype], atol=TYPES[dtype])


def test_nothing_is_packed_while_something_is_learned():
    x = torch.randn(2, 3)
    assert not is_packable(x)
    with torch.no_grad():
        assert is_packable(x)


def test_the_trunk_follows_its_weights_and_the_sizes_of_maps():
    torch.manual_seed(0)
    trunk = ResNet18(8, "batch").to(memory_format=torch.channels_last).eval()
    for module in trunk.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.running_mean)
            nn.init.uniform_(module.running_var, 0.5, 2.0)
    for size in ((64, 64), (96, 32), (64, 64)):
        x = torch.randn(2, 3, *size)
        expected = trunk(x).detach()
        with torch.no_grad():
            torch.testing.assert_close(trunk(x), expected, rtol=1e-4, atol=1e-4)
            trunk.layer2[0].conv1.weight.mul_(1.5)
            trunk.bn1.running_mean.add_(0.1)


def test_a_copy_of_a_trunk_that_has_predicted_predicts_the_same():
    torch.manual_seed(0)
    trunk = ResNet18(8, "frozen").to(memory_format=torch.channels_last).eval()
    x = torch.randn(1, 3, 64, 64)
    with torch.no_grad():
        seen = trunk(x)
        twin = copy.deepcopy(trunk)
        assert torch.equal(twin(x), seen)
        twin.conv1.weight.zero_()
        assert torch.equal(trunk(x), seen)


def test_other_types_of_numbers_go_the_plain_way():
    trunk = ResNet18(8, "batch").double().eval()
    x = torch.randn(1, 3, 64, 64, dtype=torch.float64)
    expected = trunk(x).detach()
    with torch.no_grad():
        torch.testing.assert_close(trunk(x), expected, rtol=1e-9, atol=1e-9)


def test_a_convolution_without_a_relu_is_normalised_too():
    convolution, norm = Convolution(4, 8, 1, 2), FrozenBatchNorm(8)
    norm.running_var.uniform_(0.5, 2.0)
    x = torch.randn(2, 4, 5, 5)
    expected = convolution.normalised(x, norm).detach()
    with torch.no_grad():
        torch.testing.assert_close(convolution.normalised(x, norm), expected, rtol=1e-5, atol=1e-5)
