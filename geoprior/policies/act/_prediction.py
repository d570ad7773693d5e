"""ACT's prediction as a straight line of products: weights in oneDNN's layout, constants computed once.

Rows are tokens, a batch's one after the other. All that the positions, the style of zero and the decoder's
first self-attention contribute is the same for every observation, and is an addend of some product.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from geoprior.policies.fused.packed import PackedLinear

if TYPE_CHECKING:
    from geoprior.policies.act._network import ActNetwork
    from geoprior.policies.act._transformer import Attention, DecoderLayer, EncoderLayer


class Form(NamedTuple):
    """What a prediction is prepared for.

    Attributes:
        batch: Observations.
        dtype: Of the arithmetic: float32 or bfloat16.
    """

    batch: int
    dtype: torch.dtype

    def linear(self, weight: Tensor, bias: Tensor | None, tokens: int) -> PackedLinear:
        """For so many tokens of each observation."""
        return PackedLinear(weight, bias, self.batch * tokens, self.dtype)

    def repeat(self, rows: Tensor) -> Tensor:
        """(tokens, outputs) to (batch * tokens, outputs), in the arithmetic's type."""
        return rows.to(self.dtype).repeat(self.batch, 1)


class PackedAct:
    """What an ACT network in evaluation predicts; its weights are copies.

    Args:
        network: With norms in its trunk that can be folded.
        size: (B, cameras, 3, H, W) of the frames.
        dtype: Of the arithmetic: float32 or bfloat16.
    """

    def __init__(self, network: ActNetwork, size: torch.Size, dtype: torch.dtype) -> None:
        batch, cameras = size[:2]
        form = Form(batch, dtype)
        position = network.position(cameras).float()
        tokens = len(position)
        query = network.query_position.float()
        self._form = form
        self._trunk = network.trunk.pack((batch * cameras, *size[2:]), dtype)
        kernel, bias = network.image_proj.weight.flatten(1), network.image_proj.bias
        self._image_proj = form.linear(kernel, bias, tokens - 2)
        self._pose_proj = form.linear(network.pose_proj.weight, network.pose_proj.bias, 1)
        self._latent = cast("Tensor", network.latent_proj.bias).to(dtype).expand(batch, 1, -1)
        encoders = [cast("EncoderLayer", layer) for layer in network.encoder.layers]
        decoders = [cast("DecoderLayer", layer) for layer in network.decoder.layers]
        self._encoders = [_Encoder(layer, position, form) for layer in encoders]
        self._first = _First(decoders[0], query, position, form)
        self._decoders = [_Decoder(layer, query, position, form) for layer in decoders[1:]]
        self._norm = _Norm(network.decoder.norm)
        self._head = form.linear(network.action_head.weight, network.action_head.bias, len(query))

    def __call__(self, pose: Tensor, images: Tensor) -> Tensor:
        """(B, chunk, pose_size) float32 actions for poses (B, pose_size) and frames (B, cameras, 3, H, W)."""
        batch, dtype = self._form
        maps = self._trunk(images.flatten(0, 1))
        cells = self._image_proj(maps.permute(0, 2, 3, 1).reshape(-1, maps.shape[1]))
        state = self._pose_proj(pose.to(dtype))
        tokens = [self._latent, state.unsqueeze(1), cells.view(batch, -1, cells.shape[-1])]
        memory = torch.cat(tokens, dim=1).flatten(0, 1)
        for encoder in self._encoders:
            memory = encoder(memory)
        x = self._first(memory)
        for decoder in self._decoders:
            x = decoder(x, memory)
        actions = self._head(self._norm(x)).float()
        return actions.view(batch, -1, actions.shape[-1])


class _Norm:
    def __init__(self, norm: nn.LayerNorm) -> None:
        self._arguments = (norm.normalized_shape, norm.weight.float(), norm.bias.float(), norm.eps)

    def __call__(self, x: Tensor) -> Tensor:
        return torch.layer_norm(x, *self._arguments)


class _FeedForward:
    def __init__(
        self, layer: EncoderLayer | DecoderLayer, norm: nn.LayerNorm, tokens: int, form: Form
    ) -> None:
        self._widen = form.linear(layer.linear1.weight, layer.linear1.bias, tokens)
        self._narrow = form.linear(layer.linear2.weight, layer.linear2.bias, tokens)
        self._norm = _Norm(norm)

    def __call__(self, x: Tensor) -> Tensor:
        return self._norm(self._narrow.plus(self._widen.relu(x), x))


class _Join:
    """The end of an attention: its last product, what it adds to, and the norm."""

    def __init__(self, attention: Attention, norm: nn.LayerNorm, tokens: int, form: Form) -> None:
        self._product = form.linear(attention.out_proj.weight, attention.out_proj.bias, tokens)
        self._norm = _Norm(norm)

    def __call__(self, x: Tensor, query: Tensor, key: Tensor, value: Tensor) -> Tensor:
        """Queries (B, heads, T, size), keys and values (B, heads, S, size); x (B * T, dim) and the result."""
        attended = functional.scaled_dot_product_attention(query, key, value)
        return self._norm(self._product.plus(attended.transpose(1, 2).reshape(x.shape), x))


class _Projection:
    """Some of queries, keys and values of rows without their positions: the positions' part is constant."""

    def __init__(self, attention: Attention, parts: slice, position: Tensor, form: Form) -> None:
        dim = position.shape[1]
        weight, bias = attention.in_proj_weight.reshape(3, dim, dim), attention.in_proj_bias.view(3, dim)
        shift = torch.stack([position @ part.float().t() for part in weight[:2]])
        shift = torch.cat([shift, torch.zeros_like(shift[:1])]) + bias[:, None].float()
        self._product = form.linear(weight[parts].flatten(0, 1), None, len(position))
        self._shift = form.repeat(torch.cat(list(shift[parts]), dim=1))
        self._shape = (form.batch, len(position), -1, attention.heads, dim // attention.heads)

    def __call__(self, rows: Tensor) -> Tensor:
        """(B * T, dim) to (parts, B, heads, T, size)."""
        return self._product.plus(rows, self._shift).view(self._shape).permute(2, 0, 3, 1, 4)


class _SelfAttention:
    def __init__(self, attention: Attention, norm: nn.LayerNorm, position: Tensor, form: Form) -> None:
        self._project = _Projection(attention, slice(0, 3), position, form)
        self._join = _Join(attention, norm, len(position), form)

    def __call__(self, x: Tensor) -> Tensor:
        return self._join(x, *self._project(x))


class _Encoder:
    def __init__(self, layer: EncoderLayer, position: Tensor, form: Form) -> None:
        self._attend = _SelfAttention(layer.self_attn, layer.norm1, position, form)
        self._feed_forward = _FeedForward(layer, layer.norm2, len(position), form)

    def __call__(self, x: Tensor) -> Tensor:
        return self._feed_forward(self._attend(x))


class _Look:
    """A decoder layer from its attention to the memory on."""

    def __init__(self, layer: DecoderLayer, tokens: int, position: Tensor, form: Form) -> None:
        self._project = _Projection(layer.multihead_attn, slice(1, 3), position, form)
        self._join = _Join(layer.multihead_attn, layer.norm2, tokens, form)
        self._feed_forward = _FeedForward(layer, layer.norm3, tokens, form)

    def __call__(self, x: Tensor, query: Tensor, memory: Tensor) -> Tensor:
        return self._feed_forward(self._join(x, query, *self._project(memory)))


class _Decoder:
    def __init__(self, layer: DecoderLayer, query: Tensor, position: Tensor, form: Form) -> None:
        self._attend = _SelfAttention(layer.self_attn, layer.norm1, query, form)
        self._query = _Projection(layer.multihead_attn, slice(0, 1), query, form)
        self._look = _Look(layer, len(query), position, form)

    def __call__(self, x: Tensor, memory: Tensor) -> Tensor:
        x = self._attend(x)
        return self._look(x, self._query(x)[0], memory)


class _First:
    """The first decoder layer: it sees zeros, so that all before the memory is constant."""

    def __init__(self, layer: DecoderLayer, query: Tensor, position: Tensor, form: Form) -> None:
        once = Form(1, torch.float32)
        x = _SelfAttention(layer.self_attn, layer.norm1, query, once)(torch.zeros_like(query))
        projected = _Projection(layer.multihead_attn, slice(0, 1), query, once)(x)[0]
        self._x = form.repeat(x)
        self._query = projected.to(form.dtype).expand(form.batch, -1, -1, -1)
        self._look = _Look(layer, len(query), position, form)

    def __call__(self, memory: Tensor) -> Tensor:
        return self._look(self._x, self._query, memory)
