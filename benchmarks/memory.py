"""Memory of this process and its descendants, on Linux."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from types import TracebackType
from typing import Self


def memory_bytes(pid: int) -> int:
    """Proportional set size of a process and all its descendants: what each holds alone plus its share."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
        tasks = [task.name for task in Path(f"/proc/{pid}/task").iterdir()]
        children = [Path(f"/proc/{pid}/task/{task}/children").read_text(encoding="ascii") for task in tasks]
    except OSError:  # it has ended meanwhile
        return 0
    own = sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return own * 1024 + sum(memory_bytes(int(child)) for text in children for child in text.split())


class PeakMemory:
    """Context in which the largest `memory_bytes` of this process is looked for, a few times a second.

    Attributes:
        peak: Bytes, so far.
    """

    def __init__(self, interval: float = 0.25) -> None:
        self.peak = 0
        self._interval, self._done = interval, threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        while True:
            self.peak = max(self.peak, memory_bytes(os.getpid()))
            if self._done.wait(self._interval):
                return
