"""The parts of ACT against torch's own layers and against plain formulas."""

import math

import pytest
import torch
from torch import nn

from geoprior.policies.act import _transformer
from geoprior.policies.act._positions import sinusoid_1d, sinusoid_2d
from geoprior.policies.act._transformer import Attention, DecoderLayer, EncoderLayer
from geoprior.policies.trunk import FrozenBatchNorm, ResNet18

DIM, HEADS, FFN, TOKENS = 12, 3, 20, 7


def randomised(module, seed):
    generator = torch.Generator().manual_seed(seed)
    for parameter in module.parameters():
        parameter.data = 0.3 * torch.randn(parameter.shape, generator=generator)
    return module


@pytest.fixture(params=[True, False], ids=["blocks", "operators"])
def way(request, monkeypatch):
    """Layers are computed by the fused blocks, or by torch's operators."""
    if not request.param:
        monkeypatch.setattr(_transformer, "is_fusable", lambda *_: False)
    return request.param


def test_attention_is_torchs():
    reference = randomised(nn.MultiheadAttention(DIM, HEADS, batch_first=True), 1)
    ours = Attention(DIM, HEADS, 0.0)
    ours.load_state_dict(reference.state_dict())
    query, key, value = torch.randn(4, 3, DIM), torch.randn(4, TOKENS, DIM), torch.randn(4, TOKENS, DIM)
    mask = torch.rand(4, TOKENS) < 0.7
    mask[:, 0] = True
    expected, _ = reference(query, key, value, key_padding_mask=~mask)
    torch.testing.assert_close(ours(query, key, value, mask), expected, atol=1e-6, rtol=1e-5)


def test_encoder_layer_is_torchs_post_norm_layer(way):
    reference = randomised(nn.TransformerEncoderLayer(DIM, HEADS, FFN, 0.0, batch_first=True), 2)
    ours = EncoderLayer(DIM, HEADS, FFN, 0.0)
    ours.load_state_dict(reference.state_dict())
    x = torch.randn(4, TOKENS, DIM)
    mask = torch.arange(TOKENS) < torch.tensor([[7], [1], [3], [5]])
    expected = reference(x, src_key_padding_mask=~mask)
    found = ours(x, torch.zeros(TOKENS, DIM), mask)
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-5)


def test_decoder_layer_is_torchs_post_norm_layer(way):
    reference = randomised(nn.TransformerDecoderLayer(DIM, HEADS, FFN, 0.0, batch_first=True), 3)
    ours = DecoderLayer(DIM, HEADS, FFN, 0.0)
    ours.load_state_dict(reference.state_dict())
    x, memory = torch.randn(4, 5, DIM), torch.randn(4, TOKENS, DIM)
    found = ours(x, torch.zeros(5, DIM), memory, torch.zeros(TOKENS, DIM))
    torch.testing.assert_close(found, reference(x, memory), atol=1e-5, rtol=1e-5)


def test_decoder_adds_positions_to_queries_and_keys_never_to_values(way):
    layer = randomised(DecoderLayer(DIM, HEADS, FFN, 0.0), 4)
    x, position = torch.randn(2, 5, DIM), torch.randn(5, DIM)
    memory, memory_position = torch.randn(2, TOKENS, DIM), torch.randn(TOKENS, DIM)
    attentions = []
    for name in ("self_attn", "multihead_attn"):
        attention = nn.MultiheadAttention(DIM, HEADS, batch_first=True)
        attention.load_state_dict(getattr(layer, name).state_dict())
        attentions.append(attention)
    expected = layer.norm1(x + attentions[0](x + position, x + position, x)[0])
    cross = attentions[1](expected + position, memory + memory_position, memory)[0]
    expected = layer.norm2(expected + cross)
    expected = layer.norm3(expected + layer.linear2(layer.linear1(expected).relu()))
    found = layer(x, position, memory, memory_position)
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-5)


def test_sinusoid_of_sequences_follows_the_formula():
    table = sinusoid_1d(11, 6)
    for position in range(11):
        for pair in range(3):
            angle = position / 10_000 ** (2 * pair / 6)
            assert table[position, 2 * pair] == pytest.approx(math.sin(angle), abs=1e-6)
            assert table[position, 2 * pair + 1] == pytest.approx(math.cos(angle), abs=1e-6)


def test_sinusoid_of_maps_follows_the_formula():
    table = sinusoid_2d(3, 5, 8)
    for row in range(3):
        for column in range(5):
            for pair in range(2):
                for half, place, count in ((0, row, 3), (4, column, 5)):
                    angle = 2 * math.pi * (place + 1) / (count + 1e-6) / 10_000 ** (2 * pair / 4)
                    assert table[row, column, half + 2 * pair] == pytest.approx(math.sin(angle), abs=1e-6)
                    assert table[row, column, half + 2 * pair + 1] == pytest.approx(math.cos(angle), abs=1e-6)


def torchvision_names():
    norm = ("weight", "bias", "running_mean", "running_var", "num_batches_tracked")
    yield "conv1.weight"
    yield from (f"bn1.{name}" for name in norm)
    for layer in range(1, 5):
        for block in range(2):
            for number in (1, 2):
                yield f"layer{layer}.{block}.conv{number}.weight"
                yield from (f"layer{layer}.{block}.bn{number}.{name}" for name in norm)
        if layer > 1:
            yield f"layer{layer}.0.downsample.0.weight"
            yield from (f"layer{layer}.0.downsample.1.{name}" for name in norm)


def test_trunk_has_the_tensors_of_torchvisions_resnet18():
    trunk = ResNet18(64, "batch")
    assert set(trunk.state_dict()) == set(torchvision_names())
    # torchvision's resnet18 has 11,689,512 parameters, 513,000 of them in fc.
    assert sum(parameter.numel() for parameter in trunk.parameters()) == 11_176_512
    assert trunk.layer4[0].downsample[0].weight.shape == (512, 256, 1, 1)


@pytest.mark.parametrize("norm", ["batch", "frozen", "group"])
def test_trunk_takes_any_size_and_norm(norm):
    trunk = ResNet18(8, norm)
    assert trunk(torch.randn(2, 3, 65, 96)).shape == (2, 64, 3, 3)


def test_frozen_norm_is_a_batch_norm_in_evaluation_and_never_learns():
    reference = nn.BatchNorm2d(4).eval()
    for tensor in reference.state_dict().values():
        if tensor.dtype == torch.float32:
            tensor.copy_(torch.rand(4) + 0.5)
    frozen = FrozenBatchNorm(4).train()
    weights = {k: v for k, v in reference.state_dict().items() if k != "num_batches_tracked"}
    frozen.load_state_dict(weights)
    x = torch.randn(2, 4, 3, 3)
    torch.testing.assert_close(frozen(x), reference(x))
    with torch.no_grad():
        torch.testing.assert_close(frozen(x), reference(x))
    assert not list(frozen.parameters())
