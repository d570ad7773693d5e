"""Spans of bytes from several files at once."""

from __future__ import annotations

import os
import weakref
from collections.abc import Sequence
from pathlib import Path

_MOST_OPEN = 256


class SpanReader:
    """Reads spans of files by position: safe in threads, after a fork, and when pickled.

    Args:
        paths: The files; they stay open, so that one replaced meanwhile is still read as it was.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = tuple(paths)
        # Some hundreds of open files are every process's right; beyond them each read opens its own.
        self._open = [os.open(path, os.O_RDONLY | os.O_CLOEXEC) for path in self.paths[:_MOST_OPEN]]
        weakref.finalize(self, _close, tuple(self._open))

    def __reduce__(self) -> tuple[type[SpanReader], tuple[tuple[Path, ...]]]:
        return type(self), (self.paths,)

    def read(self, file: int, offset: int, size: int) -> bytes:
        """Read a span of the file of that number.

        Raises:
            ValueError: The file ends before the span does.
        """
        if file < len(self._open):
            data = os.pread(self._open[file], size, offset)
        else:
            with self.paths[file].open("rb") as stream:
                data = os.pread(stream.fileno(), size, offset)
        if len(data) != size:
            raise ValueError(f"is cut off: {len(data)} of {size} bytes are there")
        return data


def _close(descriptors: tuple[int, ...]) -> None:
    for descriptor in descriptors:
        os.close(descriptor)
