"""The trunk without gradients: folded and laid out anew, and the same as with them."""

import copy
import pickle

import pytest
import torch
from torch import nn

from geoprior.policies.trunk import Convolution, FrozenBatchNorm, ResNet18


def make_trunk(norm, width=8):
    torch.manual_seed(0)
    trunk = ResNet18(width, norm).to(memory_format=torch.channels_last).eval()
    for module in trunk.modules():
        if isinstance(module, nn.BatchNorm2d | FrozenBatchNorm):
            nn.init.uniform_(module.running_mean)
            nn.init.uniform_(module.running_var, 0.5, 2.0)
            nn.init.uniform_(module.weight, 0.5, 1.5)
            nn.init.uniform_(module.bias)
    return trunk


@pytest.mark.parametrize("norm", ["batch", "frozen"])
def test_it_follows_its_weights_and_the_sizes_of_maps(norm):
    trunk = make_trunk(norm)
    for size in ((64, 64), (96, 32), (65, 97), (64, 64)):
        x = torch.randn(2, 3, *size)
        expected = trunk(x).detach()
        with torch.no_grad():
            torch.testing.assert_close(trunk(x), expected, rtol=1e-4, atol=1e-4)
            trunk.layer2[0].conv1.weight.mul_(1.5)
            trunk.bn1.running_mean.add_(0.1)


@pytest.mark.parametrize("batch", [1, 3])
def test_it_is_near_in_bfloat16(batch):
    trunk, x = make_trunk("batch"), torch.randn(batch, 3, 64, 96)
    expected = trunk(x).detach()
    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16):
        found = trunk(x)
    assert found.dtype == torch.bfloat16
    assert (found.float() - expected).abs().max() < 0.03 * expected.abs().max()


def test_maps_of_many_channels_and_few_cells():
    trunk, x = make_trunk("frozen", width=64), torch.randn(2, 3, 96, 70)
    expected = trunk(x).detach()
    with torch.no_grad():
        torch.testing.assert_close(trunk(x), expected, rtol=1e-4, atol=1e-4)


def test_a_copy_of_a_trunk_that_has_predicted_predicts_the_same():
    trunk, x = make_trunk("frozen"), torch.randn(1, 3, 64, 64)
    with torch.no_grad():
        seen = trunk(x)
        for twin in (copy.deepcopy(trunk), pickle.loads(pickle.dumps(trunk))):
            assert torch.equal(twin(x), seen)
            twin.conv1.weight.zero_()
            assert not torch.equal(twin(x), seen)
        assert torch.equal(trunk(x), seen)


@pytest.mark.parametrize(
    ("norm", "dtype", "tolerance"), [("batch", torch.float64, 1e-9), ("group", torch.float32, 1e-5)]
)
def test_other_types_of_numbers_and_group_norms_go_the_plain_way(norm, dtype, tolerance):
    trunk, x = make_trunk(norm).to(dtype), torch.randn(2, 3, 64, 64, dtype=dtype)
    expected = trunk(x).detach()
    with torch.no_grad():
        torch.testing.assert_close(trunk(x), expected, rtol=tolerance, atol=tolerance)


def test_a_batch_norm_in_training_takes_the_batchs_statistics():
    trunk, x = make_trunk("batch"), torch.randn(2, 3, 64, 64)
    with torch.no_grad():
        trunk(x)
        trunk.layer1[0].bn1.train()
        before = trunk.layer1[0].bn1.running_mean.clone()
        trunk(x)
    assert not torch.equal(trunk.layer1[0].bn1.running_mean, before)


def test_a_convolution_without_a_relu_is_normalised_too():
    convolution, norm = Convolution(4, 8, 1, 2), FrozenBatchNorm(8)
    norm.running_var.uniform_(0.5, 2.0)
    x = torch.randn(2, 4, 5, 5)
    expected = convolution.normalised(x, norm).detach()
    with torch.no_grad():
        torch.testing.assert_close(convolution.normalised(x, norm), expected, rtol=1e-5, atol=1e-5)
