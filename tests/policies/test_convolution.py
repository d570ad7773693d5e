"""Convolutions as products, against torch's."""

import pytest
import torch
from torch.nn import functional

from geoprior.policies._convolution import convolve

MAPS = [(3, 3), (1, 1), (2, 5), (4, 4), (6, 6), (7, 9), (12, 12)]
KERNELS = [(1, 1), (1, 2), (3, 1), (3, 2), (7, 2)]


def both(x, weight, stride, gradient):
    """Values and gradients of ours and of torch's."""
    found = []
    for function in (
        convolve,
        lambda x, weight, stride: functional.conv2d(x, weight, None, stride, weight.shape[-1] // 2),
    ):
        inputs = [tensor.clone().requires_grad_() for tensor in (x, weight)]
        y = function(*inputs, stride)
        y.backward(gradient[..., : y.shape[-2], : y.shape[-1]].to(y.dtype))
        found.append([y, *(tensor.grad for tensor in inputs)])
    return found


@pytest.mark.parametrize("layout", [torch.channels_last, torch.contiguous_format])
@pytest.mark.parametrize(("kernel", "stride"), KERNELS)
@pytest.mark.parametrize("size", MAPS)
def test_values_and_gradients_are_torchs(size, kernel, stride, layout):
    torch.manual_seed(0)
    x = torch.randn(2, 5, *size, dtype=torch.float64).contiguous(memory_format=layout)
    weight = torch.randn(6, 5, kernel, kernel, dtype=torch.float64).contiguous(memory_format=layout)
    gradient = torch.randn(2, 6, *size, dtype=torch.float64)
    ours, torchs = both(x, weight, stride, gradient)
    for found, expected in zip(ours, torchs, strict=True):
        torch.testing.assert_close(found, expected, atol=1e-10, rtol=1e-10)


@pytest.mark.parametrize("size", [(3, 3), (6, 6)])
def test_under_autocast_it_is_as_exact_as_torchs(size):
    torch.manual_seed(0)
    x, weight = torch.randn(4, 64, *size), torch.randn(64, 64, 3, 3) / 24.0
    gradient = torch.randn(4, 64, *size)
    exact, _ = both(x.double(), weight.double(), 1, gradient.double())
    with torch.autocast("cpu", torch.bfloat16):
        ours, torchs = both(x, weight, 1, gradient)
    assert ours[0].dtype == torch.bfloat16
    for found, expected, truth in zip(ours, torchs, exact, strict=True):
        assert (found - truth).abs().mean() < 1.2 * (expected - truth).abs().mean() + 1e-6


@pytest.mark.parametrize("size", [(96, 96), (7, 9), (32, 33), (1, 1), (64, 2)])
@pytest.mark.parametrize(("channels", "kernel"), [(3, 7), (1, 7), (4, 3), (3, 11)])
@pytest.mark.parametrize("half", [False, True])
def test_frames_at_steps_of_two(size, channels, kernel, half):
    torch.manual_seed(0)
    frames, weight = torch.randn(2, channels, *size), torch.randn(8, channels, kernel, kernel)
    frames, weight = frames.to(torch.bfloat16), weight.to(torch.bfloat16).float()
    frames = frames if half else frames.float()
    twin = weight.double().requires_grad_()
    exact = functional.conv2d(frames.double(), twin, None, 2, kernel // 2)
    gradient = torch.randn(exact.shape).to(torch.bfloat16)
    (expected,) = torch.autograd.grad(exact, twin, gradient.double())
    weight.requires_grad_()
    with torch.autocast("cpu", torch.bfloat16):
        y = convolve(frames, weight, 2)
    (found,) = torch.autograd.grad(y, weight, gradient)
    assert y.dtype == torch.bfloat16
    for ours, truth in ((y, exact), (found, expected)):
        assert ours.shape == truth.shape
        assert (ours.double() - truth).abs().max() < 1e-2 * truth.abs().max()


def test_frames_that_want_a_gradient_get_it():
    frames = torch.randn(2, 3, 12, 12, requires_grad=True)
    with torch.autocast("cpu", torch.bfloat16):
        y = convolve(frames, torch.randn(8, 3, 7, 7, requires_grad=True), 2)
    (gradient,) = torch.autograd.grad(y.sum(), frames)
    assert gradient.abs().sum() > 0


def test_tall_maps_of_one_column():
    """oneDNN's convolutions in bfloat16 are wrong for many of them at steps of two."""
    torch.manual_seed(0)
    x, weight = torch.randn(9, 64, 160, 2), torch.randn(128, 64, 3, 3) / 24.0
    with torch.autocast("cpu", torch.bfloat16):
        found = convolve(x.requires_grad_(), weight, 2)
    exact = functional.conv2d(x.double(), weight.double(), None, 2, 1)
    assert (found.double() - exact).abs().max() < 3e-2 * exact.abs().max()
