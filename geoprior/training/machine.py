"""What a machine is good for: decided once, written down, and kept when a training goes on."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import torch

from geoprior.errors import DataError, MachineError
from geoprior.files import read_json, write_json
from geoprior.training.memory import kept_memory

if TYPE_CHECKING:
    from pathlib import Path

    from geoprior.training.config import TrainConfig

MACHINE_NAME = "machine.json"
_WORTH = 1.3


@dataclass(frozen=True)
class Machine:
    """How the arithmetic of a training is done.

    Attributes:
        device: ``cpu`` or ``cuda``.
        precision: ``bf16``: matrix products and convolutions in bfloat16, weights and optimiser in float32;
            or ``fp32``.
        threads: The results depend on it in their last bits.
        bf16_speedup: Measured time in fp32 over time in bf16 of one product; 0 where it was not measured.
    """

    device: str
    precision: str
    threads: int
    bf16_speedup: float = 0.0


def decide_machine(
    config: TrainConfig, folder: Path, processes: int = 1, *, side_by_side: bool = False
) -> Machine:
    """What ``folder/machine.json`` says, or what the config says and a short trial finds; then it is written.

    Args:
        config: Of the training.
        folder: Where ``machine.json`` lies, or will.
        processes: That share this machine in one training.
        side_by_side: Whether it is one of several trainings that may share the machine, one thread each: two
            on two cores make 1.6 times the samples of one with two threads. Not so on a GPU.

    Raises:
        DataError: The file is damaged.
        MachineError: The config wants a GPU and torch finds none.
    """
    path = folder / MACHINE_NAME
    if path.exists():
        try:
            known = Machine(**read_json(path))
        except TypeError as error:
            raise DataError(f"{path}: not what a training wrote ({error})", "delete the folder") from error
        device = known.device if config.device == "auto" else config.device
        require_device(device)
        return Machine(
            device,
            known.precision if config.precision == "auto" else config.precision,
            config.threads or known.threads,
            known.bf16_speedup,
        )
    automatic = "cuda" if torch.cuda.is_available() else "cpu"
    device = automatic if config.device == "auto" else config.device
    require_device(device)
    cores = max(1, len(os.sched_getaffinity(0)) // processes)
    threads = config.threads or (1 if side_by_side and device == "cpu" else cores)
    speedup = measure_bf16_speedup(device) if config.precision == "auto" else 0.0
    precision = ("bf16" if speedup > _WORTH else "fp32") if config.precision == "auto" else config.precision
    machine = Machine(device, precision, threads, round(speedup, 2))
    write_json(path, asdict(machine))
    return machine


@contextmanager
def arithmetic(machine: Machine) -> Iterator[None]:
    """The machine's threads, a random state that the caller does not notice, and memory that is kept.

    On a GPU the process's own device alone is woken; convolutions are those that give the same bits twice,
    and in float32 they are in float32.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(machine.threads)
    on_gpu = machine.device == "cuda"
    devices = [torch.cuda.current_device()] if on_gpu else []
    try:
        same = {"benchmark": False, "deterministic": True, "allow_tf32": False}
        convolutions = torch.backends.cudnn.flags(enabled=True, **same) if on_gpu else nullcontext()
        with torch.random.fork_rng(devices=devices), kept_memory(), convolutions:
            yield
    finally:
        torch.set_num_threads(before)


def measure_bf16_speedup(device: str, size: int = 768, trials: int = 5) -> float:
    """Best time of a (size, size) product in fp32 over that in bf16; about 50 ms in all on a CPU."""
    return _best_time(device, torch.float32, size, trials) / _best_time(device, torch.bfloat16, size, trials)


def require_device(device: str) -> None:
    """Refuse to compute on what this process does not have.

    Raises:
        MachineError: It is a GPU and torch finds none.
    """
    if device == "cuda" and not torch.cuda.is_available():
        raise MachineError(
            "device: cuda is wanted, or this training began on one, and torch finds no GPU here",
            "install a CUDA build of torch or go on where the GPU is; or set pretrain.device and "
            "finetune.device to cpu and train anew with --replace",
        )


def _best_time(device: str, dtype: torch.dtype, size: int, trials: int) -> float:
    a = torch.ones(size, size, dtype=dtype, device=device)
    times = []
    for _ in range(trials + 1):
        begun = time.perf_counter()
        torch.mm(a, a)[0, 0].item()  # waits for a GPU
        times.append(time.perf_counter() - begun)
    return min(times[1:])
