"""Blocks of transformer layers, whose gradients are written out, against layers of torch's operators."""

import pytest
import torch

from geoprior.policies.act import _transformer
from geoprior.policies.act._transformer import DecoderLayer, Encoder, EncoderLayer

DIM, HEADS, FFN = 32, 4, 48
BATCH, TOKENS, SEEN = 3, 7, 11


def randomised(module, seed):
    generator = torch.Generator().manual_seed(seed)
    for parameter in module.parameters():
        parameter.data.copy_(0.3 * torch.randn(parameter.shape, generator=generator))
    for name, parameter in module.named_parameters():
        if name.endswith("linear1.bias"):  # no number is so near a ReLU's corner that rounding decides
            parameter.data[::2], parameter.data[1::2] = -3.0, 3.0
    return module


def encoder_case():
    mask = torch.arange(TOKENS) < torch.tensor([[7], [1], [4]])
    inputs = [torch.randn(BATCH, TOKENS, DIM), torch.randn(TOKENS, DIM)]
    return randomised(EncoderLayer(DIM, HEADS, FFN, 0.0), 1), inputs, {"mask": mask}


def part_of_the_tokens_case():
    layer, inputs, options = encoder_case()
    return layer, inputs, {**options, "wanted": 2}


def decoder_case():
    layer = randomised(DecoderLayer(DIM, HEADS, FFN, 0.0), 2)
    shapes = ((BATCH, TOKENS, DIM), (TOKENS, DIM), (BATCH, SEEN, DIM), (SEEN, DIM))
    return layer, [torch.randn(shape) for shape in shapes], {}


def differentiated(layer, inputs, options, gradient):
    """The value, and the gradients of all inputs and parameters."""
    given = [tensor.detach().clone().requires_grad_() for tensor in inputs]
    y = layer(*given, **options)
    return [y, *torch.autograd.grad(y, [*given, *layer.parameters()], gradient.to(y.dtype))]


@pytest.mark.parametrize("case", [encoder_case, part_of_the_tokens_case, decoder_case])
@pytest.mark.parametrize("half", [False, True])
def test_values_and_all_gradients_are_those_of_the_operators(case, half, monkeypatch):
    torch.manual_seed(0)
    layer, inputs, options = case()
    with torch.no_grad():
        gradient = torch.randn(layer(*inputs, **options).shape)
    with torch.autocast("cpu", torch.bfloat16, enabled=half):
        ours = differentiated(layer, inputs, options, gradient)
    monkeypatch.setattr(_transformer, "is_fusable", lambda *_: False)
    exact = differentiated(layer.double(), [x.double() for x in inputs], options, gradient.double())
    for found, right in zip(ours, exact, strict=True):
        size = right.norm() + (1.0 if half else 1e-2)
        assert (found.double() - right).norm() < (5e-2 if half else 1e-5) * size


def test_wanting_the_first_token_is_taking_it_of_all():
    torch.manual_seed(0)
    encoder = randomised(Encoder(2, DIM, HEADS, FFN, 0.0), 3)
    x, position = torch.randn(BATCH, TOKENS, DIM), torch.randn(TOKENS, DIM)
    mask = torch.arange(TOKENS) < torch.tensor([[7], [1], [4]])
    of_first, of_all = torch.zeros(BATCH, 1, DIM), torch.zeros(BATCH, TOKENS, DIM)
    of_first[:], of_all[:, :1] = 1.7, 1.7
    one = differentiated(encoder, [x, position], {"mask": mask, "wanted": 1}, of_first)
    whole = differentiated(encoder, [x, position], {"mask": mask}, of_all)
    assert one[0].shape == (BATCH, 1, DIM)
    for found, right in zip(one, [whole[0][:, :1], *whole[1:]], strict=True):
        torch.testing.assert_close(found, right, atol=1e-5, rtol=1e-4)


def test_dropout_acts_in_training_and_follows_torchs_seed():
    layer = EncoderLayer(DIM, HEADS, FFN, 0.5)
    x, position = torch.randn(BATCH, TOKENS, DIM), torch.zeros(TOKENS, DIM)
    seen = []
    for seed in (3, 3, 4):
        torch.manual_seed(seed)
        seen.append(layer(x, position))
    assert torch.equal(seen[0], seen[1])
    assert not torch.equal(seen[0], seen[2])
    layer.eval()
    assert torch.equal(layer(x, position), layer(x, position))


def test_gradients_under_dropout_are_those_of_the_masks_that_were_drawn():
    """By finite differences along a random direction, in float32 and with the same seed each time."""
    torch.manual_seed(0)
    layer = randomised(EncoderLayer(DIM, HEADS, FFN, 0.3), 4)
    x = torch.randn(BATCH, TOKENS, DIM)
    position, direction = torch.randn(TOKENS, DIM), torch.randn_like(x)
    downstream = torch.randn_like(x)

    def value(at):
        torch.manual_seed(9)
        return (layer(at, position) * downstream).sum()

    at = x.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(value(at), at)
    step = 1e-3
    slope = (value(x + step * direction) - value(x - step * direction)) / (2 * step)
    assert (gradient * direction).sum().item() == pytest.approx(slope.item(), rel=2e-2)
