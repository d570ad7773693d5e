"""Post-norm transformer layers as in DETR: positions are added to queries and keys, never to values.

Parameters are named and shaped as those of `torch.nn.MultiheadAttention` and
`torch.nn.TransformerEncoderLayer`; batches come first. On a CPU `geoprior.policies.fused.blocks` does it.
Attention is spelt out: with some twenty tokens, the backward pass of torch's fused kernel takes ten times
longer on a CPU.
"""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from geoprior.policies.fused._passes import is_fusable
from geoprior.policies.fused.blocks import Settings, feed_forward, memory_attention, self_attention
from geoprior.policies.fused.products import lay_out


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

    def forward(self, query: Tensor, key: Tensor, value: Tensor, mask: Tensor | None = None) -> Tensor:
        """Let queries look at keys; positions are added already.

        Args:
            query: (B, T, dim)
            key: (B, S, dim)
            value: (B, S, dim)
            mask: (B, S) bool, true where a key may be looked at.

        Returns:
            (B, T, dim)
        """
        sources = zip(
            (query, key, value), self.in_proj_weight.chunk(3), self.in_proj_bias.chunk(3), strict=True
        )
        query, key, value = (self._split(functional.linear(x, weight, bias)) for x, weight, bias in sources)
        scores = query @ key.transpose(-2, -1) * query.shape[-1] ** -0.5
        if mask is not None:
            scores = scores.masked_fill(~mask[:, None, None, :], float("-inf"))
        weights = functional.dropout(scores.softmax(dim=-1), self.dropout, self.training)
        attended = (weights.to(value.dtype) @ value).transpose(1, 2).flatten(2)
        return cast("Tensor", self.out_proj(attended))

    def parameters_of_block(self) -> tuple[Tensor, ...]:
        """As `geoprior.policies.fused.blocks` wants them, without the norm's."""
        return self.in_proj_weight, self.in_proj_bias, self.out_proj.weight, self.out_proj.bias

    def _split(self, x: Tensor) -> Tensor:
        return x.view(*x.shape[:-1], self.heads, -1).transpose(1, 2)


class _Layer(nn.Module):
    """Attention among the tokens and a feed-forward part, each with its residual and norm."""

    def __init__(self, dim: int, heads: int, ffn: int, dropout: float) -> None:
        super().__init__()
        self.dropout = dropout
        self.linear1 = nn.Linear(dim, ffn)
        self.linear2 = nn.Linear(ffn, dim)
        self.self_attn = Attention(dim, heads, dropout)
        self.norm1 = nn.LayerNorm(dim)
        self.norm2 = nn.LayerNorm(dim)
        lay_out(self.linear1.weight)

    def _attend_self(
        self, x: Tensor, position: Tensor, mask: Tensor | None = None, wanted: int | None = None
    ) -> Tensor:
        norm = self.norm1
        if is_fusable(x):
            parameters = (*self.self_attn.parameters_of_block(), norm.weight, norm.bias)
            return self_attention(x, position, mask, parameters, self._settings(norm, wanted or 0))
        moved = x + position
        attended = self.self_attn(moved[:, :wanted], moved, x, mask)
        return self._add_norm(x[:, :wanted], attended, norm)

    def _feed_forward(self, x: Tensor, norm: nn.LayerNorm) -> Tensor:
        first, last = self.linear1, self.linear2
        if is_fusable(x):
            parameters = (first.weight, first.bias, last.weight, last.bias, norm.weight, norm.bias)
            return feed_forward(x, parameters, self._settings(norm))
        hidden = functional.dropout(functional.relu(first(x)), self.dropout, self.training)
        return self._add_norm(x, last(hidden), norm)

    def _add_norm(self, x: Tensor, branch: Tensor, norm: nn.LayerNorm) -> Tensor:
        normalised: Tensor = norm(x + functional.dropout(branch, self.dropout, self.training))
        return normalised

    def _settings(self, norm: nn.LayerNorm, wanted: int = 0) -> Settings:
        return Settings(self.dropout, self.training, norm.eps, self.self_attn.heads, wanted)


class EncoderLayer(_Layer):
    """Self-attention, then a feed-forward layer."""

    def forward(
        self, x: Tensor, position: Tensor, mask: Tensor | None = None, wanted: int | None = None
    ) -> Tensor:
        """(B, T, dim) with positions (T, dim) and a mask (B, T), true for tokens that count.

        Returns:
            (B, T, dim), or the first ``wanted`` of the tokens.
        """
        return self._feed_forward(self._attend_self(x, position, mask, wanted), self.norm2)


class Encoder(nn.Module):
    """A stack of `EncoderLayer`."""

    def __init__(self, layers: int, dim: int, heads: int, ffn: int, dropout: float) -> None:
        super().__init__()
        self.layers = nn.ModuleList(EncoderLayer(dim, heads, ffn, dropout) for _ in range(layers))

    def forward(
        self, x: Tensor, position: Tensor, mask: Tensor | None = None, wanted: int | None = None
    ) -> Tensor:
        """See `EncoderLayer.forward`; the tokens that are not wanted are spared in the last layer."""
        for layer in self.layers[:-1]:
            x = layer(x, position, mask)
        last: Tensor = self.layers[-1](x, position, mask, wanted)
        return last


class DecoderLayer(_Layer):
    """Self-attention among the queries, attention to the memory, then a feed-forward layer."""

    def __init__(self, dim: int, heads: int, ffn: int, dropout: float) -> None:
        super().__init__(dim, heads, ffn, dropout)
        self.multihead_attn = Attention(dim, heads, dropout)
        self.norm3 = nn.LayerNorm(dim)

    def forward(self, x: Tensor, position: Tensor, memory: Tensor, memory_position: Tensor) -> Tensor:
        """(B, T, dim) queries and (B, S, dim) memory, with positions (T, dim) and (S, dim)."""
        x = self._attend_self(x, position)
        x = self._attend_memory(x, position, memory, memory_position)
        return self._feed_forward(x, self.norm3)

    def _attend_memory(self, x: Tensor, position: Tensor, memory: Tensor, memory_position: Tensor) -> Tensor:
        norm = self.norm2
        if is_fusable(x):
            parameters = (*self.multihead_attn.parameters_of_block(), norm.weight, norm.bias)
            return memory_attention(x, position, memory, memory_position, parameters, self._settings(norm))
        attended = self.multihead_attn(x + position, memory + memory_position, memory)
        return self._add_norm(x, attended, norm)


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
