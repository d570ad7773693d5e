"""What lies between the products of a transformer layer: each pass, and the pass of its gradient.

Nothing here is recorded by autograd; `geoprior.policies.fused.blocks` puts the passes together. Tensors are
on the CPU, float32 or bfloat16; rows are (rows, n) and contiguous.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from geoprior.lanes import in_lanes, numbers_of
from geoprior.policies.fused._passes import CHUNK, LEVELS, chunks_of, none_like

_DEAR = 8
"""Numbers of other passes that an exponential takes as long as."""
_SAMPLES = 4
"""Samples whose sums are added up before others join them, whatever the number of threads."""


class Dropout(NamedTuple):
    """A random mask, drawn anew by whoever needs it.

    Attributes:
        dropped: Of `LEVELS`; the scale of what is kept fits it.
        seed: Of 63 bits.
    """

    dropped: int
    seed: int


class Heads(NamedTuple):
    """How the projections of one product are shared out.

    Attributes:
        parts: Projections side by side: of queries, keys and values, or of some of them.
        moved: So many of them, from the first, have positions; values have none.
        number: Of heads in each.
    """

    parts: int
    moved: int
    number: int


class Normed(NamedTuple):
    """What the gradient of `add_norm` wants to know.

    Attributes:
        added: (rows, n) before the norm.
        moments: (rows, 2) float32 mean and reciprocal deviation.
    """

    added: Tensor
    moments: Tensor


def draw_dropout(probability: float, *, training: bool) -> Dropout:
    """A mask from torch's generator; nothing is drawn where nothing is dropped.

    The probability is rounded to a multiple of 1 / `LEVELS`: 0.1 becomes 26/256 = 0.1016.
    """
    dropped = round(probability * LEVELS) if training else 0
    return Dropout(dropped, int(torch.randint(2**63 - 1, ())) if dropped else 0)


def add_norm(
    x: Tensor, branch: Tensor, bias: Tensor, affine: tuple[Tensor, Tensor, float], dropout: Dropout
) -> tuple[Tensor, Normed]:
    """``norm(x + dropout(branch + bias))`` of rows.

    Args:
        x: (rows, n)
        branch: (rows, n)
        bias: (n,) of the branch.
        affine: Weight (n,), bias (n,) and epsilon of the norm.
        dropout: Of the branch.
    """
    from geoprior.policies.fused._kernels import drop_add_norm

    weight, shift, epsilon = affine
    normed = Normed(torch.empty_like(x), torch.empty(len(x), 2))
    y = torch.empty_like(x)
    vectors = (numbers_of(vector.float()) for vector in (weight, shift, bias))
    results = map(numbers_of, (normed.added, y, normed.moments))
    rows = (numbers_of(x), numbers_of(branch))
    in_lanes(drop_add_norm, x.numel(), *rows, *vectors, epsilon, dropout.seed, dropout.dropped, *results)
    return y, normed


def add_norm_back(
    gradient: Tensor, normed: Normed, weight: Tensor, dropout: Dropout
) -> tuple[Tensor, Tensor, Tensor]:
    """The gradients of `add_norm`.

    Returns:
        Of x (rows, n); of the branch, the same tensor where nothing is dropped; and (3, n) float32 of the
        norm's weight, its bias, and the branch's bias.
    """
    from geoprior.policies.fused._kernels import drop_add_norm_back

    added, moments = normed
    totals = torch.empty(chunks_of(added), 3, added.shape[1])
    of_x = torch.empty_like(added)
    of_branch = torch.empty_like(added) if dropout.dropped else none_like(added)
    given = map(numbers_of, (gradient, added, weight.float(), moments))
    results = map(numbers_of, (of_x, of_branch, totals))
    arguments = (CHUNK, *given, dropout.seed, dropout.dropped, *results)
    in_lanes(drop_add_norm_back, added.numel(), *arguments)
    return of_x, of_branch if dropout.dropped else of_x, totals.sum(0)


def relu_drop(x: Tensor, bias: Tensor, dropout: Dropout) -> Tensor:
    """``dropout(relu(x + bias))`` of rows (rows, n) and a bias (n,)."""
    from geoprior.policies.fused._kernels import relu_drop

    y = torch.empty_like(x)
    given = map(numbers_of, (x, bias.float()))
    in_lanes(relu_drop, x.numel(), *given, dropout.seed, dropout.dropped, numbers_of(y))
    return y


def relu_drop_back(gradient: Tensor, y: Tensor, dropout: Dropout) -> tuple[Tensor, Tensor]:
    """The gradients of `relu_drop`, of the rows and of the bias (n,) float32; ``y`` as it gave it."""
    from geoprior.policies.fused._kernels import relu_drop_back

    of_x = torch.empty_like(y)
    totals = torch.empty(chunks_of(y), y.shape[1])
    given = map(numbers_of, (gradient, y))
    kept = LEVELS / (LEVELS - dropout.dropped)
    in_lanes(relu_drop_back, y.numel(), CHUNK, *given, kept, *map(numbers_of, (of_x, totals)))
    return of_x, totals.sum(0)


def softmax_drop(
    scores: Tensor, mask: Tensor | None, scale: float, dropout: Dropout
) -> tuple[Tensor, Tensor]:
    """The softmax of scaled scores, before dropout and after it.

    Args:
        scores: (B * heads, queries, keys) contiguous.
        mask: (B, keys) bool, true where a key may be looked at; or none.
        scale: Of the scores.
        dropout: Of the weights.
    """
    from geoprior.policies.fused._kernels import softmax_drop

    allowed = torch.empty(0, scores.shape[-1], dtype=torch.bool) if mask is None else mask.contiguous()
    weights = torch.empty_like(scores)
    kept = torch.empty_like(scores) if dropout.dropped else weights
    given = (numbers_of(scores), numbers_of(allowed), scale, dropout.seed, dropout.dropped)
    in_lanes(softmax_drop, scores.numel() * _DEAR, *given, numbers_of(weights), numbers_of(kept))
    return weights, kept


def softmax_drop_back(gradient: Tensor, weights: Tensor, scale: float, dropout: Dropout) -> Tensor:
    """The gradient of the scores of `softmax_drop`; ``weights`` before dropout, as it gave them."""
    from geoprior.policies.fused._kernels import softmax_drop_back

    of_scores = torch.empty_like(weights)
    given = (numbers_of(gradient), numbers_of(weights), scale, dropout.seed, dropout.dropped)
    in_lanes(softmax_drop_back, weights.numel() * _DEAR, *given, numbers_of(of_scores))
    return of_scores


def split_heads(projected: Tensor, bias: Tensor, tokens: int, heads: Heads) -> Tensor:
    """Rows of several projections, by projection and head; ``bias`` is added, and what positions add.

    Args:
        projected: (B * T + T, parts * dim) the projections side by side: of every sample's tokens, and behind
            them of the positions.
        bias: (parts * dim,)
        tokens: T.
        heads: Which divide dim.

    Returns:
        (parts, B * heads, T, dim / heads)
    """
    from geoprior.policies.fused._kernels import split_heads

    given = projected.view(-1, tokens, heads.parts, heads.number, len(bias) // (heads.parts * heads.number))
    batch, size = len(given) - 1, given.shape[-1]
    split = projected.new_empty(heads.parts, batch, heads.number, tokens, size)
    vector = bias.float().view(given.shape[2:])
    in_lanes(
        split_heads, projected.numel(), *map(numbers_of, (given, vector)), heads.moved, numbers_of(split)
    )
    return split.view(heads.parts, -1, tokens, size)


def join_heads(gradients: Tensor, heads: Heads) -> tuple[Tensor, Tensor]:
    """The gradients of `split_heads`: of the rows, those of the positions among them, and of the bias.

    Args:
        gradients: (parts, B * heads, T, dim / heads) contiguous.
        heads: As they were.

    Returns:
        (B * T + T, parts * dim), and (parts * dim,) float32.
    """
    from geoprior.policies.fused._kernels import join_heads

    tokens, size = gradients.shape[2:]
    given = gradients.view(heads.parts, -1, heads.number, tokens, size)
    batch = given.shape[1]
    joined = gradients.new_empty(batch + 1, tokens, heads.parts, heads.number, size)
    totals = torch.empty(-(-batch // _SAMPLES), tokens, heads.parts, heads.number, size)
    in_lanes(join_heads, joined.numel(), _SAMPLES, *map(numbers_of, (given, joined, totals)))
    total = totals.sum(0)
    joined[-1, :, : heads.moved], joined[-1, :, heads.moved :] = total[:, : heads.moved], 0.0
    return joined.view((batch + 1) * tokens, -1), total.sum(0).flatten()
