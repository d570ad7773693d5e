"""My-plugin: a fresh process for every piece of work, as an executor of geoprior's."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from pydantic import Field

from geoprior import ExecutorSpec, hookimpl
from geoprior.options import Options

Item = TypeVar("Item")
Result = TypeVar("Result")


class MyPluginConfig(Options):
    """Options of the executor."""

    workers: int = Field(2, ge=1, le=1024, description="Processes at a time.")


@dataclass(frozen=True)
class MyPlugin:
    """See `geoprior.hooks.types.Executor`. What one piece of work leaves in memory, no other one sees."""

    config: MyPluginConfig

    def run(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[tuple[int, Result]]:
        """Yield ``(position in items, result)`` in the order of completion."""
        if not items:
            return
        from concurrent.futures import ProcessPoolExecutor, as_completed
        from multiprocessing import get_context

        workers = min(self.config.workers, len(items))
        pool = ProcessPoolExecutor(workers, get_context("spawn"), max_tasks_per_child=1)
        try:
            futures = {pool.submit(function, item): position for position, item in enumerate(items)}
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@hookimpl
def geoprior_executors() -> Iterable[ExecutorSpec]:
    """What this package adds."""
    yield ExecutorSpec(
        name="my-plugin",
        summary="a fresh process for every piece of work",
        config=MyPluginConfig,
        factory=MyPlugin,
    )
