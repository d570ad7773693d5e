"""The blocks of a post-norm transformer, each with its gradient as one node of autograd's graph.

A block is the products and passes of a sublayer, the residual and the norm behind it. Written out of torch's
operators a layer takes some thirty nodes forth and back, whose bookkeeping takes as long as the arithmetic of
a small batch. Positions are added to queries and keys, never to values: ``W (x + position)`` is computed as
``W x + W position``, all of it in one product, since the batch shares the positions.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import torch
from torch import Tensor

from geoprior.policies.fused._passes import at_work
from geoprior.policies.fused.products import gradient_of_rows, gradient_of_weight, product
from geoprior.policies.fused.tokens import (
    Dropout,
    Heads,
    Normed,
    add_norm,
    add_norm_back,
    draw_dropout,
    join_heads,
    relu_drop,
    relu_drop_back,
    softmax_drop,
    softmax_drop_back,
    split_heads,
)

Gradients = tuple[Tensor | None, ...]


class Settings(NamedTuple):
    """What a block is told besides tensors.

    Attributes:
        dropout: Its probability.
        training: Whether anything is dropped.
        epsilon: Of the norm.
        heads: Of the attention.
        wanted: So many tokens, from the first, come out of an attention among tokens; 0 means all.
    """

    dropout: float
    training: bool
    epsilon: float
    heads: int = 1
    wanted: int = 0


def self_attention(
    x: Tensor, position: Tensor, mask: Tensor | None, parameters: tuple[Tensor, ...], settings: Settings
) -> Tensor:
    """``norm(x + dropout(attention))`` among the tokens of x.

    Args:
        x: (B, T, dim)
        position: (T, dim)
        mask: (B, T) bool, true where a token may be looked at; or none.
        parameters: Weight (3 * dim, dim) and bias of the projections, weight and bias of the output, weight
            and bias of the norm.
        settings: The rest.

    Returns:
        (B, T, dim), or (B, wanted, dim).
    """
    y = _SelfAttention.apply(at_work(x), at_work(position), mask, settings, *parameters)  # type: ignore[no-untyped-call]
    return cast("Tensor", y)


def memory_attention(
    x: Tensor,
    position: Tensor,
    memory: Tensor,
    memory_position: Tensor,
    parameters: tuple[Tensor, ...],
    settings: Settings,
) -> Tensor:
    """``norm(x + dropout(attention))`` of the tokens of x (B, T, dim) to a memory (B, S, dim).

    See `self_attention`; positions are (T, dim) and (S, dim).
    """
    tensors = (at_work(tensor) for tensor in (x, position, memory, memory_position))
    return cast("Tensor", _MemoryAttention.apply(*tensors, settings, *parameters))  # type: ignore[no-untyped-call]


def feed_forward(x: Tensor, parameters: tuple[Tensor, ...], settings: Settings) -> Tensor:
    """``norm(x + dropout(W2 dropout(relu(W1 x + b1)) + b2))``.

    Args:
        x: (B, T, dim)
        parameters: W1 (hidden, dim), b1, W2 (dim, hidden), b2, weight and bias of the norm.
        settings: The rest.

    Returns:
        (B, T, dim)
    """
    return cast("Tensor", _FeedForward.apply(at_work(x), settings, *parameters))  # type: ignore[no-untyped-call]


class _SelfAttention(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        x: Tensor,
        position: Tensor,
        mask: Tensor | None,
        settings: Settings,
        in_weight: Tensor,
        in_bias: Tensor,
        *tail: Tensor,
    ) -> Tensor:
        batch, tokens, dim = x.shape
        wanted = settings.wanted or tokens
        ctx.heads, in_weight = Heads(3, 2, settings.heads), in_weight.to(x.dtype)
        rows = torch.cat([x.reshape(-1, dim), position])
        split = split_heads(product(rows, in_weight), in_bias, tokens, ctx.heads)
        query = split[0, :, :wanted].contiguous()
        attended, weights, ctx.attending = _attend(query, split[1], split[2], mask, settings)
        y, closed, ctx.closing = _close(x[:, :wanted].reshape(-1, dim), attended, tail, settings)
        ctx.save_for_backward(rows, in_weight, query, split, *weights, *closed)
        ctx.shape = (batch, tokens, wanted, dim)
        return y.view(batch, wanted, dim)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> Gradients:
        rows, in_weight, query, split, weights, kept, *closed = ctx.saved_tensors
        batch, tokens, wanted, dim = ctx.shape
        of_residual, of_attended, of_tail = _close_back(gradient.reshape(-1, dim), closed, ctx.closing)
        gradients = torch.empty_like(split)
        of_scores = _attend_back(of_attended, split[2], weights, kept, ctx.attending, gradients[2])
        torch.bmm(of_scores.transpose(1, 2), query, out=gradients[1])
        if wanted == tokens:
            torch.bmm(of_scores, split[1], out=gradients[0])
        else:
            gradients[0, :, wanted:] = 0.0
            gradients[0, :, :wanted] = of_scores @ split[1]
        of_projected, of_in_bias = join_heads(gradients, ctx.heads)
        of_rows = gradient_of_rows(of_projected, in_weight)
        of_x = of_rows[: batch * tokens].view(batch, tokens, dim)
        of_x[:, :wanted] += of_residual.view(batch, wanted, dim)
        of_position = of_rows[batch * tokens :]
        return of_x, of_position, None, None, gradient_of_weight(of_projected, rows), of_in_bias, *of_tail


class _MemoryAttention(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        x: Tensor,
        position: Tensor,
        memory: Tensor,
        memory_position: Tensor,
        settings: Settings,
        in_weight: Tensor,
        in_bias: Tensor,
        *tail: Tensor,
    ) -> Tensor:
        dim = x.shape[-1]
        residual = x.reshape(-1, dim)
        ctx.dim, in_weight = dim, in_weight.to(x.dtype)
        rows = torch.cat([residual, position])
        seen = torch.cat([memory.reshape(-1, dim), memory_position])
        ctx.heads = Heads(1, 1, settings.heads), Heads(2, 1, settings.heads)
        (query,) = split_heads(product(rows, in_weight[:dim]), in_bias[:dim], x.shape[1], ctx.heads[0])
        pair = split_heads(product(seen, in_weight[dim:]), in_bias[dim:], memory.shape[1], ctx.heads[1])
        attended, weights, ctx.attending = _attend(query, pair[0], pair[1], None, settings)
        y, closed, ctx.closing = _close(residual, attended, tail, settings)
        ctx.save_for_backward(rows, seen, in_weight, query, pair, *weights, *closed)
        ctx.shapes = (x.shape, memory.shape)
        return y.view(x.shape)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> Gradients:
        rows, seen, in_weight, query, pair, weights, kept, *closed = ctx.saved_tensors
        dim = ctx.dim
        of_residual, of_attended, of_tail = _close_back(gradient.reshape(-1, dim), closed, ctx.closing)
        of_pair = torch.empty_like(pair)
        of_scores = _attend_back(of_attended, pair[1], weights, kept, ctx.attending, of_pair[1])
        torch.bmm(of_scores.transpose(1, 2), query, out=of_pair[0])
        of_projected, of_query_bias = join_heads((of_scores @ pair[0])[None], ctx.heads[0])
        of_seen_projected, of_pair_bias = join_heads(of_pair, ctx.heads[1])
        of_rows = gradient_of_rows(of_projected, in_weight[:dim])
        of_seen = gradient_of_rows(of_seen_projected, in_weight[dim:])
        of_weight = torch.empty_like(in_weight)
        of_weight[:dim] = gradient_of_weight(of_projected, rows)
        of_weight[dim:] = gradient_of_weight(of_seen_projected, seen)
        of_bias = torch.cat([of_query_bias, of_pair_bias])
        (x, memory), (count, seen_count) = ctx.shapes, (len(of_residual), len(of_seen))
        of_rows[:count] += of_residual
        tokens = seen_count - memory[1]
        of_x, of_memory = of_rows[:count].view(x), of_seen[:tokens].view(memory)
        return of_x, of_rows[count:], of_memory, of_seen[tokens:], None, of_weight, of_bias, *of_tail


class _FeedForward(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, x: Tensor, settings: Settings, weight: Tensor, bias: Tensor, *tail: Tensor
    ) -> Tensor:
        rows, weight = x.reshape(-1, x.shape[-1]), weight.to(x.dtype)
        ctx.dropout = draw_dropout(settings.dropout, training=settings.training)
        hidden = relu_drop(product(rows, weight), bias, ctx.dropout)
        y, closed, ctx.closing = _close(rows, hidden, tail, settings)
        ctx.save_for_backward(rows, weight, *closed)
        return y.view(x.shape)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> Gradients:
        rows, weight, *closed = ctx.saved_tensors
        of_x, of_hidden, of_tail = _close_back(gradient.reshape(rows.shape), closed, ctx.closing)
        of_product, of_bias = relu_drop_back(of_hidden, closed[0], ctx.dropout)
        of_x = of_x + gradient_of_rows(of_product, weight)
        of_weight = gradient_of_weight(of_product, rows)
        return of_x.view(gradient.shape), None, of_weight, of_bias, *of_tail


def _attend(
    query: Tensor, key: Tensor, value: Tensor, mask: Tensor | None, settings: Settings
) -> tuple[Tensor, tuple[Tensor, Tensor], tuple[Dropout, float, int]]:
    """Attended rows (B * T, dim), weights before and after dropout, and what else the gradient needs.

    All of (B * heads, tokens, n).
    """
    dropout = draw_dropout(settings.dropout, training=settings.training)
    scale = query.shape[-1] ** -0.5
    weights, kept = softmax_drop(torch.bmm(query, key.transpose(1, 2)), mask, scale, dropout)
    slabs, tokens, size = query.shape
    attended = torch.bmm(kept, value).view(-1, settings.heads, tokens, size).transpose(1, 2)
    rows = attended.reshape(slabs * tokens // settings.heads, -1)
    return rows, (weights, kept), (dropout, scale, settings.heads)


def _attend_back(
    gradient: Tensor,
    value: Tensor,
    weights: Tensor,
    kept: Tensor,
    attending: tuple[Dropout, float, int],
    of_value: Tensor,
) -> Tensor:
    """The gradient of the scores; that of the values is written to ``of_value``."""
    dropout, scale, heads = attending
    tokens = kept.shape[1]
    by_head = gradient.view(-1, tokens, heads, value.shape[-1]).transpose(1, 2).reshape(len(kept), tokens, -1)
    torch.bmm(kept.transpose(1, 2), by_head, out=of_value)
    return softmax_drop_back(torch.bmm(by_head, value.transpose(1, 2)), weights, scale, dropout)


def _close(
    residual: Tensor, inner: Tensor, tail: tuple[Tensor, ...], settings: Settings
) -> tuple[Tensor, tuple[Tensor, ...], Dropout]:
    """The end of every block: last product, dropout, residual and norm of rows."""
    weight, bias, norm_weight, norm_bias = tail
    weight = weight.to(inner.dtype)
    dropout = draw_dropout(settings.dropout, training=settings.training)
    affine = (norm_weight, norm_bias, settings.epsilon)
    y, normed = add_norm(residual, product(inner, weight), bias, affine, dropout)
    return y, (inner, weight, norm_weight, *normed), dropout


def _close_back(
    gradient: Tensor, closed: list[Tensor], dropout: Dropout
) -> tuple[Tensor, Tensor, tuple[Tensor, ...]]:
    """Gradients of the residual, of the inner rows, and of the tail."""
    inner, weight, norm_weight, added, moments = closed
    normed = Normed(added, moments)
    of_residual, of_branch, totals = add_norm_back(gradient.contiguous(), normed, norm_weight, dropout)
    of_weight = gradient_of_weight(of_branch, inner)
    of_norm, of_shift, of_bias = totals.unbind()
    return of_residual, gradient_of_rows(of_branch, weight), (of_weight, of_bias, of_norm, of_shift)
