"""Post-norm transformer layers as in DETR: positions are added to queries and keys, never to values.

Parameters are named and shaped as those of `torch.nn.MultiheadAttention` and
`torch.nn.TransformerEncoderLayer`; batches come first. Attention is spelt out: with some twenty
tokens, the backward pass of torch's fused kernel takes ten times longer on a CPU.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from geoprior.policies.fused.products import lay_out, linear
from geoprior.policies.fused.tokens import add_norm, attention_weights, relu_drop, split_heads


class Attention(nn.Module):
    """Multi-head attention with dropout on the weights."""

    def __init__(self, dim: int, heads: int, dropout: float) -> None:
        super().__init__()
        self.heads, self.dropout = heads, dropout
        self.in_proj_weight = lay_out(nn.Parameter(torch.empty(3 * dim, dim)))
        self.in_proj_bias = nn.Parameter(torch.zeros(3 * dim))
        self.out_proj = nn.Linear(dim, dim)
        nn.init.xavier_uniform_(self.in_proj_weight)
        nn.init.zeros_(self.out_proj.bias)

    def attend_self(self, x: Tensor, position: Tensor, mask: Tensor | None = None) -> Tensor:
        """Attend among the tokens of ``x``; the bias of ``out_proj`` is left to whoever adds the result.

        ``W (x + position)`` is computed as ``W x + W position``, all of it in one product: the batch shares
        the positions, and values have none.

        Args:
            x: (B, T, dim).
            position: (T, dim).
            mask: (B, T) bool, true where a token may be looked at.

        Returns:
            (B, T, dim)
        """
        rows = torch.cat([x.flatten(0, 1), position])
        projected = linear(rows, self.in_proj_weight)
        return self._attend(*split_heads(projected, self.in_proj_bias, x.shape[1], self.heads), mask)

    def attend_memory(self, query: Tensor, key: Tensor, value: Tensor) -> Tensor:
        """(B, T, dim) queries look at (B, S, dim) keys and values, positions added already; else the same."""
        sources = zip(
            (query, key, value), self.in_proj_weight.chunk(3), self.in_proj_bias.chunk(3), strict=True
        )
        projected = [self._split(functional.linear(x, weight, bias)) for x, weight, bias in sources]
        return self._attend(*projected)

    def _attend(self, query: Tensor, key: Tensor, value: Tensor, mask: Tensor | None = None) -> Tensor:
        scale = query.shape[-1] ** -0.5
        scores = query @ key.transpose(-2, -1)
        weights = attention_weights(scores, mask, scale, self.dropout, training=self.training)
        attended = (weights.to(value.dtype) @ value).transpose(1, 2).flatten(2)
        return linear(attended, self.out_proj.weight)

    def _split(self, x: Tensor) -> Tensor:
        return x.view(*x.shape[:-1], self.heads, -1).transpose(1, 2)


class _Layer(nn.Module):
    """What encoder and decoder layers share: a feed-forward part, and norms after what is added."""

    def __init__(self, dim: int, ffn: int, dropout: float) -> None:
        super().__init__()
        self.dropout = dropout
        self.linear1 = nn.Linear(dim, ffn)
        self.linear2 = nn.Linear(ffn, dim)
        lay_out(self.linear1.weight)

    def _feed_forward(self, x: Tensor, norm: nn.LayerNorm) -> Tensor:
        hidden = linear(x, self.linear1.weight)
        hidden = relu_drop(hidden, self.linear1.bias, self.dropout, training=self.training)
        return self._add_norm(x, linear(hidden, self.linear2.weight), self.linear2, norm)

    def _add_norm(self, x: Tensor, branch: Tensor, last: nn.Linear, norm: nn.LayerNorm) -> Tensor:
        """The bias of the branch's last product is added here."""
        return add_norm(x, branch, last.bias, norm, self.dropout, training=self.training)


class EncoderLayer(_Layer):
    """Self-attention, then a feed-forward layer."""

    def __init__(self, dim: int, heads: int, ffn: int, dropout: float) -> None:
        super().__init__(dim, ffn, dropout)
        self.self_attn = Attention(dim, heads, dropout)
        self.norm1 = nn.LayerNorm(dim)
        self.norm2 = nn.LayerNorm(dim)

    def forward(self, x: Tensor, position: Tensor, mask: Tensor | None = None) -> Tensor:
        """(B, T, dim) with positions (T, dim) and a mask (B, T), true for tokens that count."""
        attended = self.self_attn.attend_self(x, position, mask)
        x = self._add_norm(x, attended, self.self_attn.out_proj, self.norm1)
        return self._feed_forward(x, self.norm2)


class Encoder(nn.Module):
    """A stack of `EncoderLayer`."""

    def __init__(self, layers: int, dim: int, heads: int, ffn: int, dropout: float) -> None:
        super().__init__()
        self.layers = nn.ModuleList(EncoderLayer(dim, heads, ffn, dropout) for _ in range(layers))

    def forward(self, x: Tensor, position: Tensor, mask: Tensor | None = None) -> Tensor:
        """See `EncoderLayer.forward`."""
        for layer in self.layers:
            x = layer(x, position, mask)
        return x


class DecoderLayer(_Layer):
    """Self-attention among the queries, attention to the memory, then a feed-forward layer."""

    def __init__(self, dim: int, heads: int, ffn: int, dropout: float) -> None:
        super().__init__(dim, ffn, dropout)
        self.self_attn = Attention(dim, heads, dropout)
        self.multihead_attn = Attention(dim, heads, dropout)
        self.norm1 = nn.LayerNorm(dim)
        self.norm2 = nn.LayerNorm(dim)
        self.norm3 = nn.LayerNorm(dim)

    def forward(self, x: Tensor, position: Tensor, memory: Tensor, memory_position: Tensor) -> Tensor:
        """(B, T, dim) queries and (B, S, dim) memory, with positions (T, dim) and (S, dim)."""
        attended = self.self_attn.attend_self(x, position)
        x = self._add_norm(x, attended, self.self_attn.out_proj, self.norm1)
        attended = self.multihead_attn.attend_memory(x + position, memory + memory_position, memory)
        x = self._add_norm(x, attended, self.multihead_attn.out_proj, self.norm2)
        return self._feed_forward(x, self.norm3)


class Decoder(nn.Module):
    """A stack of `DecoderLayer` and a last norm."""

    def __init__(self, layers: int, dim: int, heads: int, ffn: int, dropout: float) -> None:
        super().__init__()
        self.layers = nn.ModuleList(DecoderLayer(dim, heads, ffn, dropout) for _ in range(layers))
        self.norm = nn.LayerNorm(dim)

    def forward(self, x: Tensor, position: Tensor, memory: Tensor, memory_position: Tensor) -> Tensor:
        """See `DecoderLayer.forward`."""
        for layer in self.layers:
            x = layer(x, position, memory, memory_position)
        normalised: Tensor = self.norm(x)
        return normalised
