"""Executors of one machine: this process, or a pool of spawned ones."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import TYPE_CHECKING, TypeVar

from pydantic import Field

from geoprior import ExecutorSpec, hookimpl
from geoprior.errors import MachineError
from geoprior.options import Options

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Item = TypeVar("Item")
Result = TypeVar("Result")


class SerialConfig(Options):
    """No options."""


class LocalConfig(Options):
    """Options of the process pool."""

    workers: int = Field(0, ge=0, le=1024, description="Worker processes; 0 takes one for each usable core.")


class SerialExecutor:
    """Runs everything in this process, in order."""

    def run(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[tuple[int, Result]]:
        """See `geoprior.hooks.types.Executor`."""
        for position, item in enumerate(items):
            yield position, function(item)


class LocalExecutor:
    """A pool of spawned processes: none inherits threads or a GL context."""

    def __init__(self, config: LocalConfig) -> None:
        self.workers = config.workers or len(os.sched_getaffinity(0))

    def run(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[tuple[int, Result]]:
        """See `geoprior.hooks.types.Executor`.

        An error or Ctrl-C ends the workers where they are, as a kill would: what is being done may take
        hours more. Results left unread do not.

        Raises:
            MachineError: A worker died (killed, out of memory, or a crash in a library).
        """
        if not items:
            return
        context = get_context("spawn")
        ends, held = context.Pipe(duplex=False)
        pool = ProcessPoolExecutor(
            max_workers=min(self.workers, len(items)),
            mp_context=context,
            initializer=_prepare_pool_worker,
            initargs=(os.getpid(), ends),
        )
        try:
            futures = {pool.submit(function, item): index for index, item in enumerate(items)}
            for future in as_completed(futures):
                yield futures.pop(future), _result(future)
        except GeneratorExit:
            raise
        except BaseException:
            held.close()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
            held.close()
            ends.close()


def _result(future: Future[Result]) -> Result:
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise MachineError(
            "a worker process died: it was killed, ran out of memory, or a library crashed",
            "run the same command again to go on; with less memory, lower executor.workers",
        ) from error


def prepare_worker(parent: int) -> None:
    """Leave Ctrl-C to the parent, use one core, and do not outlive the parent.

    Numerical libraries ask for their number of threads when they are loaded, which comes after this, unless
    the script that the processes belong to loads them at its top.
    """
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent(parent)


def _prepare_pool_worker(parent: int, ends: Connection) -> None:
    prepare_worker(parent)
    threading.Thread(target=_end_with_pipe, args=(ends,), daemon=True).start()


def _end_with_pipe(ends: Connection) -> None:
    """End this process when the pipe's other end is closed, which nothing is ever written to.

    An event of multiprocessing would do, were it not that to set one hangs once a waiting process was killed.
    """
    ends.poll(None)
    os._exit(1)


def end_with_parent(parent: int) -> None:
    """End this process, from a thread, when its parent is gone, however that ended."""
    threading.Thread(target=_end_with_parent, args=(parent,), daemon=True).start()


def _end_with_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


@hookimpl
def geoprior_executors() -> Iterable[ExecutorSpec]:
    """The two that need nothing but Python."""
    yield ExecutorSpec(
        name="serial",
        summary="one piece of work after the other, in this process",
        config=SerialConfig,
        factory=lambda _: SerialExecutor(),
    )
    yield ExecutorSpec(
        name="local",
        summary="a pool of processes on this machine",
        config=LocalConfig,
        factory=LocalExecutor,
    )
