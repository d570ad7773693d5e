"""Named tensors: to and from safetensors files, and strictly into a module."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from geoprior.errors import DataError
from geoprior.files import atomic_path

if TYPE_CHECKING:
    from torch import Tensor, nn

_REBUILD = "build the policy with the options of the checkpoint's JSON"


def fill(
    policy: nn.Module, tensors: Mapping[str, Tensor], path: Path | str, prefixes: tuple[str, ...] = ("",)
) -> tuple[str, ...]:
    """Copy tensors into the policy's own, where names begin with one of the prefixes; strict.

    Raises:
        DataError: Naming the first tensor that is missing, extra, or of another shape or type.
    """
    own = {name: tensor for name, tensor in policy.state_dict().items() if name.startswith(prefixes)}
    _refuse(path, "lacks the tensor", own.keys() - tensors.keys())
    _refuse(path, "has the extra tensor", tensors.keys() - own.keys())
    for name, tensor in own.items():
        other = tensors[name]
        if other.shape != tensor.shape or other.dtype != tensor.dtype:
            raise DataError(
                f"{path}: tensor {name!r} is {other.dtype} {tuple(other.shape)}, the policy's is "
                f"{tensor.dtype} {tuple(tensor.shape)}",
                _REBUILD,
            )
    with torch.no_grad():
        for name, tensor in own.items():
            tensor.copy_(tensors[name])
    return tuple(own)


def _refuse(path: Path | str, fault: str, names: Iterable[str]) -> None:
    ordered = sorted(names)
    if ordered:
        more = f" (and {len(ordered) - 1} more)" if len(ordered) > 1 else ""
        raise DataError(
            f"{path}: {fault} {ordered[0]!r}{more}",
            _REBUILD,
        )


def save_tensors(path: Path, tensors: Mapping[str, Tensor], metadata: Mapping[str, str]) -> None:
    """Write a safetensors file atomically; tensors that share memory are written one by one.

    Raises:
        DataError: The folder cannot be written.
    """
    with atomic_path(path) as temporary:
        contiguous = _apart({name: tensor.detach().contiguous() for name, tensor in tensors.items()})
        try:
            save_file(contiguous, temporary, dict(metadata))
        except SafetensorError as error:
            raise OSError(str(error)) from error


def _apart(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The same without two in one memory, as tied weights are."""
    seen: set[int] = set()
    apart = {}
    for name, tensor in tensors.items():
        place = tensor.untyped_storage().data_ptr()
        apart[name] = tensor.clone() if place in seen else tensor
        seen.add(place)
    return apart


def load_tensors(path: Path) -> dict[str, Tensor]:
    """Read a safetensors file.

    Raises:
        DataError: It is cut off or something else.
    """
    try:
        return load_file(path)
    except (SafetensorError, OSError) as error:
        raise DataError(
            f"{path}: not readable as safetensors ({error})", "delete it and run the same command again"
        ) from error
