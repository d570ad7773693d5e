"""Stagers here, or each in a process of its own, asked in the same way."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache, partial
from multiprocessing import get_context
from typing import Any, Protocol, TypeVar

from geoprior.errors import MachineError
from geoprior.executors.local import prepare_worker
from geoprior.sources._stager import Stager, StagerConfig

Answer = TypeVar("Answer")


class Worker(Protocol):
    """Somebody with a stager."""

    def ask(self, method: Callable[..., Answer], *arguments: object) -> Callable[[], Answer]:
        """Ask for ``method(stager, *arguments)``, a method of `Stager`; the function returned waits for it.

        Raises:
            MachineError: Here or when the answer is waited for: the worker is dead.
            Exception: When the answer is waited for: what the method raised.
        """
        ...

    def close(self) -> None:
        """End; may be called twice."""
        ...


class WorkerHere:
    """Works in the thread that waits for the answer."""

    def __init__(self, config: StagerConfig) -> None:
        self._stager = Stager(config)

    def ask(self, method: Callable[..., Answer], *arguments: object) -> Callable[[], Answer]:
        """See `Worker`."""
        return partial(method, self._stager, *arguments)

    def close(self) -> None:
        """See `Worker`."""


class WorkerProcess:
    """Works in a spawned process, so that staging never holds this interpreter's lock.

    It leaves Ctrl-C to this process, and ends when it is closed or when this process is gone, however.
    """

    def __init__(self, config: StagerConfig) -> None:
        self._pool = ProcessPoolExecutor(
            max_workers=1,
            mp_context=get_context("spawn"),
            initializer=prepare_worker,  # before anything that loads a numerical library
            initargs=(os.getpid(),),
        )
        self._pool.submit(_begin, config)

    def ask(self, method: Callable[..., Answer], *arguments: object) -> Callable[[], Answer]:
        """See `Worker`."""
        try:
            return partial(_wait, self._pool.submit(_answer, method, arguments))
        except BrokenProcessPool as error:
            raise _dead() from error

    def close(self) -> None:
        """See `Worker`."""
        self._pool.shutdown(wait=True, cancel_futures=True)


def _wait(future: Future[Answer]) -> Answer:
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise _dead() from error


def _dead() -> MachineError:
    return MachineError(
        "a process that makes episodes died: it was killed, ran out of memory, or a library crashed",
        "run the same command again to go on; with less memory, lower pretrain.frame_cache_mb, or set "
        "pretrain.source.workers=0",
    )


_stager: Callable[[], Stager] | None = None
"""Of a worker process: builds its stager at the first call."""


def _begin(config: StagerConfig) -> None:
    global _stager
    _stager = lru_cache(partial(Stager, config))


def _answer(method: Callable[..., Any], arguments: tuple[object, ...]) -> Any:
    """An error while the stager is built is raised here; in `_begin` it would break the pool and be lost."""
    assert _stager is not None
    return method(_stager(), *arguments)
