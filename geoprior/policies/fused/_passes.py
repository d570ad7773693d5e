"""What the functions of this package share: when they apply, and in which type."""

from __future__ import annotations

import torch
from torch import Tensor

_TYPES = frozenset({torch.float32, torch.bfloat16})
LEVELS = 256
"""Random numbers of dropout are bytes: probabilities are multiples of 1/256."""
CHUNK = 64
"""Rows whose sums are added up before others join them; the sums do not depend on the number of threads."""


def is_fusable(*tensors: Tensor) -> bool:
    """Whether the passes can do it: on the CPU, all float32 or all bfloat16, and nobody traces."""
    dtype = tensors[0].dtype
    alike = all(tensor.is_cpu and tensor.dtype == dtype for tensor in tensors)
    return alike and dtype in _TYPES and not torch.compiler.is_compiling()


def arithmetic_of(x: Tensor) -> torch.dtype:
    """The type that products with x on a CPU are computed in: autocast's, else its own."""
    return torch.get_autocast_dtype("cpu") if torch.is_autocast_enabled("cpu") else x.dtype


def at_work(x: Tensor) -> Tensor:
    """The tensor in the type that it is computed with."""
    return x.to(arithmetic_of(x))


def none_like(x: Tensor) -> Tensor:
    """No rows of it: how a kernel is told that there is none."""
    return x.new_empty((0, *x.shape[1:]))


def chunks_of(rows: Tensor) -> int:
    """How many times `CHUNK` rows they are."""
    return -(-len(rows) // CHUNK)
