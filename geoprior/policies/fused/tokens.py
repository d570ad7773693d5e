"""Dropout, norms and attention weights of transformer layers.

On a CPU the probability of dropout is rounded to a multiple of 1/256, the scale of what is kept fits the
rounded one, and a mask's seed comes from torch's generator.
"""

from __future__ import annotations

from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from geoprior.lanes import in_lanes, numbers_of
from geoprior.policies.fused._passes import (
    CHUNK,
    LEVELS,
    chunks_of,
    draw_seed,
    is_fusable,
    levels_of,
    none_like,
)


def add_norm(
    x: Tensor, branch: Tensor, bias: Tensor, norm: nn.LayerNorm, dropout: float, *, training: bool
) -> Tensor:
    """``norm(x + dropout(branch + bias))`` over the last axis; x and branch have one shape."""
    if is_fusable(x, branch):
        dropped = levels_of(dropout, training=training)
        inputs = (x, branch, bias, norm.weight, norm.bias, norm.eps, dropped)
        return cast("Tensor", _AddNorm.apply(*inputs))  # type: ignore[no-untyped-call]
    normalised: Tensor = norm(x + functional.dropout(branch + bias.to(branch.dtype), dropout, training))
    return normalised


def relu_drop(x: Tensor, bias: Tensor, dropout: float, *, training: bool) -> Tensor:
    """``dropout(relu(x + bias))``."""
    if is_fusable(x):
        inputs = (x, bias, levels_of(dropout, training=training))
        return cast("Tensor", _ReLUDrop.apply(*inputs))  # type: ignore[no-untyped-call]
    return functional.dropout(functional.relu(x + bias.to(x.dtype)), dropout, training)


def attention_weights(
    scores: Tensor, mask: Tensor | None, scale: float, dropout: float, *, training: bool
) -> Tensor:
    """``dropout(softmax(scores * scale))``, masked.

    Args:
        scores: (B, heads, queries, keys)
        mask: (B, keys) bool, true where a key may be looked at; or none.
        scale: Of the scores.
        dropout: Probability.
        training: Whether anything is dropped.
    """
    if is_fusable(scores):
        inputs = (scores, mask, scale, levels_of(dropout, training=training))
        return cast("Tensor", _AttentionWeights.apply(*inputs))  # type: ignore[no-untyped-call]
    scores = scores * scale
    if mask is not None:
        scores = scores.masked_fill(~mask[:, None, None, :], float("-inf"))
    return functional.dropout(scores.softmax(dim=-1), dropout, training)


def split_heads(projected: Tensor, bias: Tensor, tokens: int, heads: int) -> tuple[Tensor, Tensor, Tensor]:
    """Queries, keys and values by heads, ``bias`` added, and to the first two what the positions add.

    Args:
        projected: (B * T + T, 3 * dim) the three side by side: of every sample's tokens, and behind them of
            the positions.
        bias: (3 * dim,)
        tokens: T.
        heads: They divide dim.

    Returns:
        Three times (B, heads, T, dim / heads).
    """
    parts = projected.view(-1, tokens, 3, heads, projected.shape[-1] // (3 * heads))
    if is_fusable(projected):
        split = _SplitHeads.apply(parts, bias.view(parts.shape[2:]))  # type: ignore[no-untyped-call]
        return cast("tuple[Tensor, Tensor, Tensor]", split)
    samples, positions = parts[:-1], parts[-1]
    positions = torch.cat([positions[:, :2], torch.zeros_like(positions[:, 2:])], dim=1)
    moved = samples + positions + bias.to(projected.dtype).view(parts.shape[2:])
    query, key, value = moved.permute(2, 0, 3, 1, 4)
    return query, key, value


class _AddNorm(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        x: Tensor,
        branch: Tensor,
        branch_bias: Tensor,
        weight: Tensor,
        bias: Tensor,
        epsilon: float,
        dropped: int,
    ) -> Tensor:
        from geoprior.policies.fused._kernels import drop_add_norm

        rows = _flat(x.contiguous())
        seed = draw_seed(dropped)
        affine = torch.stack([weight, bias, branch_bias]).float()
        added, y = torch.empty_like(rows), torch.empty_like(rows)
        moments = torch.empty(len(rows), 2)
        given = map(numbers_of, (rows, _flat(branch.contiguous()), affine))
        results = map(numbers_of, (added, y, moments))
        in_lanes(drop_add_norm, rows.numel(), *given, epsilon, seed, dropped, *results)
        ctx.save_for_backward(added, weight, moments)
        ctx.seed, ctx.dropped = seed, dropped
        return y.view_as(x)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        from geoprior.policies.fused._kernels import drop_add_norm_back

        added, weight, moments = ctx.saved_tensors
        totals = torch.empty(chunks_of(added), 3, added.shape[1])
        of_x = torch.empty_like(added)
        of_branch = torch.empty_like(added) if ctx.dropped else none_like(added)
        given = map(numbers_of, (_flat(gradient.contiguous()), added, weight.float(), moments))
        results = map(numbers_of, (of_x, of_branch, totals))
        arguments = (CHUNK, *given, ctx.seed, ctx.dropped, *results)
        in_lanes(drop_add_norm_back, added.numel(), *arguments)
        of_weight, of_bias, of_branch_bias = totals.sum(0)
        shaped = of_x.view_as(gradient)
        branched = of_branch.view_as(gradient) if ctx.dropped else shaped
        return shaped, branched, of_branch_bias, of_weight, of_bias, None, None


class _ReLUDrop(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, bias: Tensor, dropped: int) -> Tensor:
        from geoprior.policies.fused._kernels import relu_drop

        rows = _flat(x.contiguous())
        y = torch.empty_like(rows)
        given = map(numbers_of, (rows, bias.float()))
        in_lanes(relu_drop, rows.numel(), *given, draw_seed(dropped), dropped, numbers_of(y))
        ctx.save_for_backward(y)
        ctx.kept = LEVELS / (LEVELS - dropped)
        return y.view_as(x)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, Tensor, None]:
        from geoprior.policies.fused._kernels import relu_drop_back

        (y,) = ctx.saved_tensors
        of_x = torch.empty_like(y)
        totals = torch.empty(chunks_of(y), y.shape[1])
        given = map(numbers_of, (_flat(gradient.contiguous()), y))
        in_lanes(relu_drop_back, y.numel(), CHUNK, *given, ctx.kept, *map(numbers_of, (of_x, totals)))
        return of_x.view_as(gradient), totals.sum(0), None


class _AttentionWeights(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, scores: Tensor, mask: Tensor | None, scale: float, dropped: int) -> Tensor:
        from geoprior.policies.fused._kernels import softmax_drop

        scores = scores.contiguous()
        slabs = scores.flatten(0, 1)
        allowed = torch.empty(0, slabs.shape[-1], dtype=torch.bool) if mask is None else mask.contiguous()
        weights = torch.empty_like(slabs)
        kept = torch.empty_like(slabs) if dropped else weights
        seed = draw_seed(dropped)
        in_lanes(
            softmax_drop,
            slabs.numel() * _DEAR,
            numbers_of(slabs),
            numbers_of(allowed),
            scale,
            seed,
            dropped,
            numbers_of(weights),
            numbers_of(kept),
        )
        ctx.save_for_backward(weights)
        ctx.scale, ctx.seed, ctx.dropped = scale, seed, dropped
        return kept.view_as(scores)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        from geoprior.policies.fused._kernels import softmax_drop_back

        (weights,) = ctx.saved_tensors
        of_scores = torch.empty_like(weights)
        slabs = gradient.contiguous().view_as(weights)
        arrays = (numbers_of(slabs), numbers_of(weights), ctx.scale, ctx.seed, ctx.dropped)
        in_lanes(softmax_drop_back, slabs.numel() * _DEAR, *arrays, numbers_of(of_scores))
        return of_scores.view_as(gradient), None, None, None


_DEAR = 8
"""Numbers of other passes that an exponential takes as long as."""
_SAMPLES = 4
"""Samples whose sums are added up before others join them, whatever the number of threads."""


class _SplitHeads(torch.autograd.Function):
    @staticmethod
    def forward(_: Any, projected: Tensor, bias: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        from geoprior.policies.fused._kernels import split_heads

        sources, tokens, three, heads, size = projected.shape
        query, key, value = projected.new_empty(three, sources - 1, heads, tokens, size)
        given = map(numbers_of, (projected.contiguous(), bias.float()))
        in_lanes(split_heads, projected.numel(), *given, tuple(map(numbers_of, (query, key, value))))
        return query, key, value

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(_: Any, *gradients: Tensor) -> tuple[Tensor, Tensor]:
        from geoprior.policies.fused._kernels import join_heads

        batch, heads, tokens, size = gradients[0].shape
        of_projected = gradients[0].new_empty(batch + 1, tokens, 3, heads, size)
        totals = torch.empty(-(-batch // _SAMPLES), tokens, 3, heads, size)
        parts = tuple(numbers_of(gradient.contiguous()) for gradient in gradients)
        results = map(numbers_of, (of_projected, totals))
        in_lanes(join_heads, of_projected.numel(), _SAMPLES, parts, *results)
        total = totals.sum(0)
        of_projected[-1, :, :2], of_projected[-1, :, 2] = total[:, :2], 0.0
        return of_projected, total.sum(0)


def _flat(x: Tensor) -> Tensor:
    return x.view(-1, x.shape[-1])
