"""The processes that train together, as torchrun starts them; a lone process is a team of one.

A batch goes through the network in `TrainConfig.microbatches` parts, whoever computes them: every process
takes an equal share of the parts, and gradients, metrics and running statistics are the means over all of
them. So the same config gives the same training, up to the rounding of sums, on one process and on many.
"""

from __future__ import annotations

import atexit
import json
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import torch
from torch import distributed

from geoprior.errors import ConfigError
from geoprior.executors.local import end_with_parent

if TYPE_CHECKING:
    from torch import Tensor

_PATIENCE = timedelta(days=7)
"""How long a process waits for the others: one may be generating the data of a large run."""


@dataclass(frozen=True)
class Team:
    """The processes of one training.

    Attributes:
        rank: Of this process, from 0.
        size: Number of processes.
        local_size: Of those on this machine.
    """

    rank: int = 0
    size: int = 1
    local_size: int = 1

    @property
    def leads(self) -> bool:
        """Whether this process writes files and talks."""
        return self.rank == 0

    def share_of(self, microbatches: int) -> range:
        """The parts of a batch that this process computes.

        Raises:
            ConfigError: They cannot be shared out evenly.
        """
        if microbatches % self.size:
            raise ConfigError(
                f"{self.size} processes cannot share {microbatches} microbatches evenly",
                f"set pretrain.microbatches and finetune.microbatches to a multiple of {self.size}",
            )
        each = microbatches // self.size
        return range(self.rank * each, (self.rank + 1) * each)

    def add_up(self, tensors: Iterable[Tensor]) -> None:
        """Replace every tensor by its sum over the processes, in place; the same bits in all of them."""
        if self.size == 1:
            return
        for kind in (groups := _by_kind(tensors)):
            flat = torch.cat([tensor.reshape(-1) for tensor in groups[kind]])
            distributed.all_reduce(flat)
            parts = torch.split(flat, [tensor.numel() for tensor in groups[kind]])
            for tensor, part in zip(groups[kind], parts, strict=True):
                tensor.copy_(part.view_as(tensor))

    def agree(self, decide: Callable[[], Any]) -> Any:
        """What the leader decides, a JSON value; the others wait for it."""
        if self.size == 1:
            return decide()
        content = json.dumps(decide()).encode() if self.leads else b""
        length = torch.tensor([len(content)])
        distributed.broadcast(length, src=0)
        letters = torch.zeros(int(length), dtype=torch.uint8)
        if self.leads:
            letters.copy_(torch.tensor(list(content), dtype=torch.uint8))
        distributed.broadcast(letters, src=0)
        return json.loads(bytes(letters.tolist()))


@lru_cache(maxsize=1)
def team() -> Team:
    """The team of this process, by the variables that torchrun sets."""
    size = int(os.environ.get("WORLD_SIZE", "1"))
    if size == 1:
        return Team()
    local_size = int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    on_gpus = torch.cuda.is_available() and torch.cuda.device_count() >= local_size
    if on_gpus:
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    distributed.init_process_group("cpu:gloo,cuda:nccl" if on_gpus else "gloo", timeout=_PATIENCE)
    atexit.register(distributed.destroy_process_group)
    end_with_parent(os.getppid())
    return Team(int(os.environ["RANK"]), size, local_size)


def _by_kind(tensors: Iterable[Tensor]) -> dict[tuple[str, torch.dtype], list[Tensor]]:
    groups: dict[tuple[str, torch.dtype], list[Tensor]] = {}
    for tensor in tensors:
        groups.setdefault((tensor.device.type, tensor.dtype), []).append(tensor)
    return groups
