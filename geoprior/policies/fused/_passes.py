"""What the functions of this package share: when they apply, and their random masks."""

from __future__ import annotations

import torch
from torch import Tensor

LEVELS = 256
"""Random numbers of dropout are bytes: probabilities are multiples of 1/256."""
CHUNK = 64
"""Rows whose sums are added up before others join them; the sums do not depend on the number of threads."""


def is_fusable(*tensors: Tensor) -> bool:
    """Whether the passes can do it: on the CPU, all float32 or all bfloat16, and nobody traces."""
    types = {tensor.dtype for tensor in tensors}
    on_cpu = all(tensor.device.type == "cpu" for tensor in tensors)
    return on_cpu and types in ({torch.float32}, {torch.bfloat16}) and not torch.compiler.is_compiling()


def levels_of(probability: float, *, training: bool) -> int:
    """How many of `LEVELS` are dropped: 0.1 becomes 26/256 = 0.1016, and what is kept is scaled to fit."""
    return round(probability * LEVELS) if training else 0


def draw_seed(dropped: int) -> int:
    """Of a mask, from torch's generator; nothing is drawn where nothing is dropped."""
    return int(torch.randint(2**63 - 1, ())) if dropped else 0


def none_like(x: Tensor) -> Tensor:
    """No rows of it: how a kernel is told that there is none."""
    return x.new_empty((0, *x.shape[1:]))


def chunks_of(rows: Tensor) -> int:
    """How many times `CHUNK` rows they are."""
    return -(-len(rows) // CHUNK)
