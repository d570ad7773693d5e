"""Progress that suits the reader: a bar on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from tqdm import tqdm

_SECONDS_BETWEEN_LINES = 10.0


class Track:
    """One running count; get it from `track`."""

    def __init__(self, label: str, total: int, unit: str, done: int, *, quiet: bool = False) -> None:
        self.label, self.total, self.unit, self.done = label, total, unit, done
        self._begun = self._said = time.monotonic()
        self._first = done
        self._quiet = quiet
        self._bar = (
            tqdm(total=total, initial=done, desc=label, unit=unit, dynamic_ncols=True, leave=True)
            if sys.stderr.isatty() and not quiet
            else None
        )
        if self._bar is None:
            self._say("begins" if done == 0 else "goes on")

    def advance(self, count: int = 1, **fields: object) -> None:
        """Count ``count`` more units done; ``fields`` are shown beside the count."""
        self.done += count
        if self._bar is not None:
            if fields:
                self._bar.set_postfix({key: str(value) for key, value in fields.items()}, refresh=False)
            self._bar.update(count)
        elif time.monotonic() - self._said >= _SECONDS_BETWEEN_LINES:
            self._say(" ".join(f"{key}={value}" for key, value in fields.items()))

    def close(self) -> None:
        """End the bar or print the last line."""
        if self._bar is not None:
            self._bar.close()
            return
        seconds = time.monotonic() - self._begun
        rate = (self.done - self._first) / seconds if seconds > 0 else 0.0
        self._say(f"{seconds:.1f} s, {rate:.1f} {self.unit}/s")

    def _say(self, text: str) -> None:
        self._said = time.monotonic()
        if self._quiet:
            return
        print(f"{self.label}: {self.done}/{self.total} {self.unit} {text}".rstrip(), file=sys.stderr)


def say(text: str) -> None:
    """A line on stderr."""
    print(text, file=sys.stderr)


@contextmanager
def track(label: str, total: int, unit: str, done: int = 0, *, quiet: bool = False) -> Iterator[Track]:
    """Show progress on stderr.

    Args:
        label: What is being done.
        total: Units in all.
        unit: What is counted, in the plural.
        done: Units that an earlier, interrupted run has done already.
        quiet: Say nothing.
    """
    tracker = Track(label, total, unit, done, quiet=quiet)
    try:
        yield tracker
    finally:
        tracker.close()
