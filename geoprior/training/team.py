"""The processes that train together, as torchrun starts them; a lone process is a team of one.

A batch goes through the network in `TrainConfig.microbatches` parts, whoever computes them: every process
takes an equal share of the parts, and gradients, metrics and running statistics are the means over all of
them. So the same config gives the same training, up to the rounding of sums, on one process and on many.
"""

from __future__ import annotations

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
        local_rank: Of this process among them.
    """

    rank: int = 0
    size: int = 1
    local_size: int = 1
    local_rank: int = 0

    @property
    def leads(self) -> bool:
        """Whether this process writes files and talks."""
        return self.rank == 0

    @property
    def has_gpus(self) -> bool:
        """Whether each process of this machine has a GPU of its own."""
        return torch.cuda.is_available() and torch.cuda.device_count() >= self.local_size

    def take(self, device: str) -> None:
        """Work on the GPU that is this process's own, if on one."""
        if device == "cuda" and self.size > 1 and self.has_gpus:
            torch.cuda.set_device(self.local_rank)

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
    """The team of this process, by the variables that torchrun sets.

    Raises:
        ConfigError: One of them is missing or no number.
    """
    size = _variable("WORLD_SIZE", "1")
    if size == 1:
        return Team()
    found = Team(_variable("RANK"), size, _variable("LOCAL_WORLD_SIZE", "1"), _variable("LOCAL_RANK", "0"))
    distributed.init_process_group("cpu:gloo,cuda:nccl" if found.has_gpus else "gloo", timeout=_PATIENCE)
    end_with_parent(os.getppid())
    return found


def disband() -> None:
    """Take leave of the others once all are done; not after an error, since NCCL waits for everybody here."""
    if distributed.is_available() and distributed.is_initialized():
        distributed.destroy_process_group()
        team.cache_clear()


def _variable(name: str, default: str = "") -> int:
    said = os.environ.get(name, default)
    if not said.isdecimal():
        raise ConfigError(f"{name} is {said!r}, not a number", "start the processes with torchrun")
    return int(said)


def _by_kind(tensors: Iterable[Tensor]) -> dict[tuple[str, torch.dtype], list[Tensor]]:
    groups: dict[tuple[str, torch.dtype], list[Tensor]] = {}
    for tensor in tensors:
        groups.setdefault((tensor.device.type, tensor.dtype), []).append(tensor)
    return groups
