"""Post-norm transformer layers as in DETR: positions are added to queries and keys, never to values.

Parameters are named and shaped as those of `torch.nn.MultiheadAttention` and
`torch.nn.TransformerEncoderLayer`; batches come first. Attention is spelt out: with some twenty
tokens, the backward pass of torch's fused kernel takes ten times longer on a CPU.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from geoprior.policies.act._dropout import dropout


class Attention(nn.Module):
    """Multi-head attention with dropout on the weights."""

    def __init__(self, dim: int, heads: int, dropout: float) -> None:
        super().__init__()
        self.heads, self.dropout = heads, dropout
        self.in_proj_weight = nn.Parameter(torch.empty(3 * dim, dim))
        self.in_proj_bias = nn.Parameter(torch.zeros(3 * dim))
        self.out_proj = nn.Linear(dim, dim)
        nn.init.xavier_uniform_(self.in_proj_weight)
        nn.init.zeros_(self.out_proj.bias)

    def attend_self(self, x: Tensor, position: Tensor, mask: Tensor | None = None) -> Tensor:
        """Attend among the tokens of ``x``.

        ``W (x + position)`` is computed as ``W x + W position``: one product for queries, keys and
        values, and a small one for the positions, which the batch shares.

        Args:
            x: (B, T, dim).
            position: (T, dim).
            mask: (B, T) bool, true where a token may be looked at.

        Returns:
            (B, T, dim)
        """
        dim = x.shape[-1]
        shift = functional.linear(position, self.in_proj_weight)[:, : 2 * dim]
        projected = functional.linear(x, self.in_proj_weight, self.in_proj_bias)
        query, key, value = (projected + functional.pad(shift, (0, dim))).chunk(3, dim=-1)
        return self._attend(query, key, value, mask)

    def attend_memory(self, query: Tensor, key: Tensor, value: Tensor) -> Tensor:
        """(B, T, dim) queries look at (B, S, dim) keys and values, positions added already."""
        sources = zip(
            (query, key, value), self.in_proj_weight.chunk(3), self.in_proj_bias.chunk(3), strict=True
        )
        projected = [functional.linear(x, weight, bias) for x, weight, bias in sources]
        return self._attend(*projected)

    def _attend(self, query: Tensor, key: Tensor, value: Tensor, mask: Tensor | None = None) -> Tensor:
        query, key, value = (self._split(x) for x in (query, key, value))
        scores = query @ key.transpose(-2, -1) * query.shape[-1] ** -0.5
        if mask is not None:
            scores = scores.masked_fill(~mask[:, None, None, :], float("-inf"))
        weights = dropout(scores.softmax(dim=-1), self.dropout, training=self.training).to(value.dtype)
        joined: Tensor = self.out_proj((weights @ value).transpose(1, 2).flatten(2))
        return joined

    def _split(self, x: Tensor) -> Tensor:
        return x.view(*x.shape[:-1], self.heads, -1).transpose(1, 2)


class EncoderLayer(nn.Module):
    """Self-attention, then a feed-forward layer."""

    def __init__(self, dim: int, heads: int, ffn: int, dropout: float) -> None:
        super().__init__()
        self.dropout = dropout
        self.self_attn = Attention(dim, heads, dropout)
        self.linear1 = nn.Linear(dim, ffn)
        self.linear2 = nn.Linear(ffn, dim)
        self.norm1 = nn.LayerNorm(dim)
        self.norm2 = nn.LayerNorm(dim)

    def forward(self, x: Tensor, position: Tensor, mask: Tensor | None = None) -> Tensor:
        """(B, T, dim) with positions (T, dim) and a mask (B, T), true for tokens that count."""
        x = self.norm1(x + self._drop(self.self_attn.attend_self(x, position, mask)))
        hidden = self._drop(functional.relu(self.linear1(x)))
        normalised: Tensor = self.norm2(x + self._drop(self.linear2(hidden)))
        return normalised

    def _drop(self, x: Tensor) -> Tensor:
        return dropout(x, self.dropout, training=self.training)


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


class DecoderLayer(nn.Module):
    """Self-attention among the queries, attention to the memory, then a feed-forward layer."""

    def __init__(self, dim: int, heads: int, ffn: int, dropout: float) -> None:
        super().__init__()
        self.dropout = dropout
        self.self_attn = Attention(dim, heads, dropout)
        self.multihead_attn = Attention(dim, heads, dropout)
        self.linear1 = nn.Linear(dim, ffn)
        self.linear2 = nn.Linear(ffn, dim)
        self.norm1 = nn.LayerNorm(dim)
        self.norm2 = nn.LayerNorm(dim)
        self.norm3 = nn.LayerNorm(dim)

    def forward(self, x: Tensor, position: Tensor, memory: Tensor, memory_position: Tensor) -> Tensor:
        """(B, T, dim) queries and (B, S, dim) memory, with positions (T, dim) and (S, dim)."""
        x = self.norm1(x + self._drop(self.self_attn.attend_self(x, position)))
        attended = self.multihead_attn.attend_memory(x + position, memory + memory_position, memory)
        x = self.norm2(x + self._drop(attended))
        hidden = self._drop(functional.relu(self.linear1(x)))
        normalised: Tensor = self.norm3(x + self._drop(self.linear2(hidden)))
        return normalised

    def _drop(self, x: Tensor) -> Tensor:
        return dropout(x, self.dropout, training=self.training)


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
