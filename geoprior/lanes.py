"""Compiled loops on torch's threads. Importing this module imports torch and numba.

numba's OpenMP layer finds the OpenMP library that torch has loaded, so loops over `numba.prange` run on the
very threads that torch's operators run on. A pool of threads beside them would have to share the cores with
torch's, which go on spinning for milliseconds after every operator: measured, it gave nothing.
"""

from __future__ import annotations

from threading import Lock, local
from typing import TYPE_CHECKING, Any

import numba
import torch
from threadpoolctl import ThreadpoolController

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray
    from torch import Tensor

GRAIN = 2**14
"""Numbers that are worth a thread of their own."""


def in_lanes(kernel: Callable[..., None], numbers: int, *arguments: Any) -> None:
    """Call ``kernel(lanes, *arguments)`` with as many lanes as pay, at most torch's number of threads.

    Args:
        kernel: Of `geoprior.compiled.shared` or its like.
        numbers: That it works on; more where they are dear.
        arguments: Arrays and numbers.
    """
    threads = torch.get_num_threads()
    if getattr(_here, "threads", None) != threads:
        _use(threads)
    lanes = max(1, min(threads, numbers // GRAIN))
    if _turns is None:
        kernel(lanes, *arguments)
        return
    with _turns:
        kernel(lanes, *arguments)


def stay_alone() -> None:
    """Keep the torch operators of the Python thread that calls this on that thread.

    OpenMP gives every Python thread that runs an operator a team of its own. With more threads in teams than
    there are cores, GNU's library lets all teams sleep where they would wait awake, and a step of a training,
    which meets thousands of such places, takes twice as long.
    """
    torch.get_num_threads()  # torch sets a thread's number when it is first asked; this comes before ours
    ThreadpoolController().select(user_api="openmp").limit(limits=1)


def numbers_of(tensor: Tensor) -> NDArray[Any]:
    """A view of a tensor on the CPU, of its own shape; bfloat16 as the bits of unsigned integers."""
    if tensor.requires_grad:
        tensor = tensor.detach()
    array: NDArray[Any] = (tensor.view(torch.uint16) if tensor.dtype == torch.bfloat16 else tensor).numpy()
    return array


_here = local()
"""What each of Python's threads has asked numba for."""
_turns: Lock | None = None
"""Held by callers: numba's own pool of threads, where there is no OpenMP, takes one at a time."""


def _use(threads: int) -> None:
    global _turns
    numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    torch.set_num_threads(threads)  # OpenMP's number does not survive the choice
    if numba.threading_layer() == "workqueue":
        _turns = _turns or Lock()
    _here.threads = threads
