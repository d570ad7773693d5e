"""Memory that a training frees stays with the process until the training ends."""

from __future__ import annotations

import ctypes
import gc
import platform
from collections.abc import Iterator
from contextlib import contextmanager

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Options of glibc's ``mallopt``."""
_LARGEST = 2**25
"""Of the threshold for mapped blocks that every release of glibc takes."""
_KEPT = (2**31 - 1, 2**30)
_USUAL = (2**26, _LARGEST)
"""Where glibc's own rule takes the two thresholds in a process that frees large blocks."""


@contextmanager
def kept_memory() -> Iterator[None]:
    """Keep the C library from handing freed blocks back to the system meanwhile.

    A step frees what it took, and by default glibc gives large blocks back at once; the next step then has
    some 40,000 pages to ask for and to have zeroed anew. Without glibc nothing is done.
    """
    if platform.libc_ver()[0] != "glibc":
        yield
        return
    libc = ctypes.CDLL(None)
    _set_thresholds(libc, _KEPT)
    try:
        yield
    finally:
        _set_thresholds(libc, _USUAL)
        libc.malloc_trim(0)


def release_memory() -> None:
    """Hand what is free back to the system: a run's next stages have processes of their own."""
    gc.collect()
    if platform.libc_ver()[0] == "glibc":
        ctypes.CDLL(None).malloc_trim(0)


def _set_thresholds(libc: ctypes.CDLL, thresholds: tuple[int, int]) -> None:
    trim, mapped = thresholds
    # Refused above 32 MiB by older releases, and to set either one ends glibc's own rule for both.
    if not libc.mallopt(_MMAP_THRESHOLD, mapped):
        libc.mallopt(_MMAP_THRESHOLD, _LARGEST)
    libc.mallopt(_TRIM_THRESHOLD, trim)
