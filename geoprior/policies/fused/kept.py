"""What is made from a module's tensors once, for as long as they are what they were."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from torch import Tensor, nn

Made = TypeVar("Made")
State = tuple[tuple[int, int], ...]


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


def state_of(module: nn.Module) -> State | None:
    """Numbers that differ once one of its parameters or buffers was written to or exchanged.

    None where a part of it is in training mode.
    """
    modules: list[nn.Module | None] = [module]
    tensors: list[Tensor | None] = []
    for part in modules:
        if part is None:
            continue
        if part.training:
            return None
        tensors += part._parameters.values()
        tensors += part._buffers.values()
        modules += part._modules.values()
    return versions_of(tensors)


def versions_of(tensors: Iterable[Tensor | None]) -> State:
    """Numbers that differ once one of the tensors was written to or another stands in its place."""
    return tuple((tensor.data_ptr(), tensor._version) for tensor in tensors if tensor is not None)
