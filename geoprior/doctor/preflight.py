"""Before pip: does this machine have what the installation needs?

robosuite needs pynput, and pynput needs evdev, which is compiled on installation. Without a compiler or the
kernel's headers pip fails after minutes with a page of C errors; here it is said at once, in a line.

Standard library only; run as a file: ``python3 geoprior/doctor/preflight.py``.
"""

from __future__ import annotations

import ctypes.util
import importlib.util
import shutil
import sys
import sysconfig
from pathlib import Path

if __package__:
    from geoprior.doctor import remedies
else:
    import remedies  # type: ignore[import-not-found, no-redef]

OLDEST_PYTHON = (3, 11)


def missing() -> list[tuple[str, str]]:
    """What the installation lacks, each with the line that mends it."""
    checks = [
        (
            sys.version_info >= OLDEST_PYTHON,
            "Python 3.11 or newer (found {}.{})".format(*sys.version_info[:2]),
            remedies.PYTHON + "   # or: make PYTHON=python3.12 run",
        ),
        (importlib.util.find_spec("ensurepip") is not None, "Python's venv module", remedies.PYTHON),
        (_has_compiler(), "a C compiler (evdev, which robosuite needs, is compiled)", remedies.COMPILER),
        (_python_headers().is_file(), f"Python's headers ({_python_headers()})", remedies.COMPILER),
        (
            Path("/usr/include/linux/input.h").is_file(),
            "the kernel's headers (linux/input.h)",
            remedies.COMPILER,
        ),
        (_has_gl(), "a GL library for off-screen rendering (libEGL or libOSMesa)", remedies.EGL),
    ]
    return [(what, mend) for present, what, mend in checks if not present]


def main() -> int:
    """Print what is missing; 0 if nothing is, else 5, the exit code for an unfit machine."""
    found = missing()
    for what, mend in found:
        print(f"missing: {what}\n    {mend}", file=sys.stderr)  # noqa: T201
    if found:
        print(f"all at once:\n    {remedies.EVERYTHING}", file=sys.stderr)  # noqa: T201
    return 5 if found else 0


def _has_compiler() -> bool:
    return any(shutil.which(name) for name in ("cc", "gcc", "clang"))


def _python_headers() -> Path:
    return Path(sysconfig.get_paths()["include"]) / "Python.h"


def _has_gl() -> bool:
    return any(ctypes.util.find_library(name) for name in ("EGL", "OSMesa"))


if __name__ == "__main__":
    sys.exit(main())
