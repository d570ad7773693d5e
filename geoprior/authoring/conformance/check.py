"""A check of a contract: a sentence that must hold of a spec, and the function that finds out."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, NoReturn

import numpy as np


class BrokenContractError(AssertionError):
    """A spec does not keep its contract.

    Args:
        fault: What is wrong, with the seed, the step or the camera.
        remedy: What the author of the plug-in must do.
    """

    def __init__(self, fault: str, remedy: str = "") -> None:
        super().__init__(f"{fault}; {remedy}" if remedy else fault)
        self.fault = fault
        self.remedy = remedy


@dataclass(frozen=True)
class Check:
    """One sentence of a contract.

    Attributes:
        sentence: What holds of a spec that keeps it, for example ``its solids are closed``.
        run: Takes the spec; raises `BrokenContractError`, or whatever the plug-in raises.
        slow: Whether it takes more than a second or two: it simulates.
    """

    sentence: str
    run: Callable[..., None]
    slow: bool = False

    def __str__(self) -> str:
        return self.sentence


def require(good: object, fault: str, remedy: str = "") -> None:
    """Raise unless ``good``.

    Raises:
        BrokenContractError: With the fault and the remedy.
    """
    if not good:
        refuse(fault, remedy)


def refuse(fault: str, remedy: str = "") -> NoReturn:
    """Raise.

    Raises:
        BrokenContractError: With the fault and the remedy.
    """
    raise BrokenContractError(fault, remedy)


def require_array(
    array: object, where: str, shape: tuple[int | None, ...], *types: type[np.generic]
) -> np.ndarray[Any, Any]:
    """The array, if it has a shape (None stands for any length), one of the types, and finite numbers.

    Raises:
        BrokenContractError: It has not.
    """
    expected = f"{' or '.join(kind.__name__ for kind in types)} {shape}".replace("None", "any")
    if not isinstance(array, np.ndarray):
        refuse(f"{where}: expected an array, {expected}, found {type(array).__name__}")
    fits = len(array.shape) == len(shape) and all(
        want in (None, have) for want, have in zip(shape, array.shape, strict=True)
    )
    require(
        fits and array.dtype in [np.dtype(kind) for kind in types],
        f"{where}: expected {expected}, found {array.dtype} {array.shape}",
    )
    require(np.isfinite(array).all(), f"{where}: a number is not finite")
    return array


def digest(value: object) -> str:
    """SHA-256 of arrays and numbers, however they are nested: equal values have equal digests."""
    content = hashlib.sha256()
    _feed(content, value)
    return content.hexdigest()


def _feed(content: Any, value: object) -> None:
    if isinstance(value, np.ndarray):
        content.update(f"{value.dtype}{value.shape}".encode())
        content.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Mapping):
        _feed(content, list(value.items()))
    elif isinstance(value, (list, tuple)):
        content.update(f"[{len(value)}".encode())
        for item in value:
            _feed(content, item)
    elif is_dataclass(value):
        _feed(content, [getattr(value, field.name) for field in fields(value)])
    else:
        content.update(repr(value).encode())
