"""What is made from a module's tensors once, for as long as they are what they were."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from torch import nn

Made = TypeVar("Made")


class Kept(Generic[Made]):
    """One thing and the state that it was made in; copies and pickles are empty."""

    def __init__(self) -> None:
        self._entry: tuple[object, Made] | None = None

    def get(self, state: object, make: Callable[[], Made]) -> Made:
        """What was made in an equal state, or what ``make`` makes."""
        entry = self._entry
        if entry is None or entry[0] != state:
            entry = self._entry = None  # frees it before the next is made
            entry = self._entry = (state, make())
        return entry[1]

    def __reduce__(self) -> tuple[type[Kept[Made]], tuple[()]]:
        return type(self), ()


def state_of(module: nn.Module) -> tuple[int, ...] | None:
    """Numbers that differ once one of its parameters or buffers was written to or exchanged.

    None where a part of it is in training mode.
    """
    numbers: list[int] = []
    modules = [module]
    while modules:
        part = modules.pop()
        if part.training:
            return None
        for tensors in (part._parameters, part._buffers):
            for tensor in tensors.values():
                if tensor is not None:
                    numbers += (tensor.data_ptr(), tensor._version)
        modules.extend(child for child in part._modules.values() if child is not None)
    return tuple(numbers)
