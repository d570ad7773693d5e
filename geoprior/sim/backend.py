"""Import robosuite as this program needs it: quiet, with a GL backend that the machine has.

Import robosuite nowhere else at the top of a module that could be loaded first: robosuite decides about
the GL backend when it is imported, and takes EGL without looking.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import logging
import os
import warnings
from functools import lru_cache
from importlib.util import find_spec

from geoprior.errors import MachineError

SIM_REMEDY = "pip install 'geoprior[sim]'"
GL_REMEDY = "apt-get install libegl1 libgl1-mesa-dri (EGL), or libosmesa6 with MUJOCO_GL=osmesa"
BACKENDS = ("egl", "osmesa")
_LIBRARIES = {
    "egl": ("libEGL.so.1", "libEGL.so"),
    "osmesa": ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"),
}


def choose_gl() -> str:
    """Name the GL backend of this process and set MUJOCO_GL to it.

    Returns:
        What MUJOCO_GL says if it is set, else the first of `BACKENDS` whose library loads.

    Raises:
        MachineError: MUJOCO_GL names no headless backend, or no library is there.
    """
    # Mesa would start a thread a core in every worker; for frames this small they cost more than they do.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    wanted = os.environ.get("MUJOCO_GL", "").strip().lower()
    if wanted and wanted not in BACKENDS:
        raise MachineError(
            f"MUJOCO_GL={wanted!r}: rendering without a display needs one of {', '.join(BACKENDS)}",
            "unset MUJOCO_GL, or set it to egl or osmesa",
        )
    for backend in (wanted,) if wanted else BACKENDS:
        if _loads(backend):
            os.environ["MUJOCO_GL"] = backend
            return backend
    tried = wanted or " or ".join(BACKENDS)
    raise MachineError(f"OpenGL: no library for {tried} on this machine", GL_REMEDY)


def require_simulation() -> None:
    """Refuse to simulate where the extra `sim` is not installed.

    Raises:
        MachineError: mujoco or robosuite is missing.
    """
    missing = [name for name in ("mujoco", "robosuite") if find_spec(name) is None]
    if missing:
        raise MachineError(f"arms cannot be simulated here: {missing[0]} is not installed", SIM_REMEDY)


@lru_cache(maxsize=1)
def prepare_robosuite() -> None:
    """Import robosuite with its set-up advice muted; its warnings from then on and all errors are heard.

    Raises:
        MachineError: robosuite or mujoco cannot be imported.
    """
    choose_gl()
    advice = logging.getLogger("robosuite_logs")
    advice.addFilter(_below_error)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import robosuite  # noqa: F401 - for its side effects: it registers its environments
    except ImportError as error:
        raise MachineError(f"robosuite cannot be imported: {error}", SIM_REMEDY) from error
    finally:
        advice.removeFilter(_below_error)
    # What is left below a warning is the action space's layout, said at every reset.
    advice.setLevel(logging.WARNING)


def _loads(backend: str) -> bool:
    for name in _LIBRARIES[backend]:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


def _below_error(record: logging.LogRecord) -> bool:
    return record.levelno >= logging.ERROR
