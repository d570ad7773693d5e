"""Machine code from Python functions, kept on disk. Importing this module imports numba.

What is kept is thrown away when the function's own file changes, and only then: numbers and tables that are
made in other modules must come as arguments, and a compiled function calls none of another module.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numba

if TYPE_CHECKING:
    from collections.abc import Callable

Function = TypeVar("Function", bound="Callable[..., Any]")


_LOOPS = dict.fromkeys(
    ("comprehension", "reduction", "inplace_binop", "setitem", "numpy", "stencil", "fusion"), False
) | {"prange": True}
"""Only loops that say so are shared."""


def compiled(function: Function) -> Function:
    """Compile, and keep the machine code on disk where numba finds a folder that it can write to.

    The code runs without the interpreter's lock, divides as NumPy does, and never reorders floating-point
    sums: what was compiled just now is optimised less often than what comes from the disk, and would take
    another order.
    """
    return _compile(function)


def shared(function: Function) -> Function:
    """The same for a function whose loops over `numba.prange` are shared by threads; see `geoprior.lanes`."""
    return _compile(function, parallel=_LOOPS)


def inlined(function: Function) -> Function:
    """The same for a few lines that compiled functions of its module call once for every row."""
    return _compile(function, inline="always")


def _compile(function: Function, **options: Any) -> Function:
    njit: Any = numba.njit
    options |= {"error_model": "numpy", "nogil": True}
    try:
        machine_code: Function = njit(cache=True, **options)(function)
    except RuntimeError:  # numba: no locator available for the cache
        machine_code = njit(**options)(function)
    return machine_code
