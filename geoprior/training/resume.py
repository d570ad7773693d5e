"""The state from which a killed training goes on: one safetensors file, replaced as a whole."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from safetensors import SafetensorError, safe_open

from geoprior.errors import DataError
from geoprior.policies.tensors import fill, load_tensors, save_tensors

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor, nn

    from geoprior.training.average import WeightAverage

RESUME_NAME = "resume.safetensors"
_FORMAT = "geoprior-resume-1"
_AVERAGE = "average."
_START_OVER = "remove that folder and run the same command again to train from the start"


@dataclass(frozen=True)
class Progress:
    """How far a training is.

    Attributes:
        step: Optimiser steps done.
        seconds: Wall time they took, over all processes.
        averages: Running means of the metrics.
    """

    step: int
    seconds: float
    averages: Mapping[str, float]


def save_progress(
    folder: Path,
    fingerprint: str,
    progress: Progress,
    policy: nn.Module,
    optimizer: torch.optim.Optimizer,
    average: WeightAverage | None = None,
) -> None:
    """Write weights, their average if there is one, optimiser state and progress.

    Raises:
        DataError: The folder cannot be written.
    """
    tensors = {f"policy.{name}": tensor for name, tensor in policy.state_dict().items()}
    for name, parameter in policy.named_parameters():
        for key, value in optimizer.state.get(parameter, {}).items():
            tensors[f"optimizer.{name}.{key}"] = value
    if average:
        tensors |= {f"{_AVERAGE}{name}": tensor for name, tensor in average.policy.state_dict().items()}
    state = {
        "fingerprint": fingerprint,
        "step": progress.step,
        "seconds": progress.seconds,
        "averages": dict(progress.averages),
    }
    save_tensors(folder / RESUME_NAME, tensors, {"format": _FORMAT, "state": json.dumps(state)})


def load_progress(
    folder: Path, fingerprint: str, policy: nn.Module, optimizer: torch.optim.Optimizer
) -> Progress | None:
    """Restore what `save_progress` wrote, in place.

    Returns:
        How far it is, or None where nothing was saved.

    Raises:
        DataError: The file is damaged, or of a training with another config, seed, data or machine setting.
    """
    path = folder / RESUME_NAME
    if not path.exists():
        return None
    state = _read_state(path)
    require_same_training(path, state.get("fingerprint"), fingerprint)
    tensors = load_tensors(path)
    fill(policy, _below("policy.", tensors), path)
    for name, parameter in policy.named_parameters():
        saved = _below(f"optimizer.{name}.", tensors)
        if saved:
            optimizer.state[parameter] = {key: _laid_out(value, parameter) for key, value in saved.items()}
    return Progress(int(state["step"]), float(state["seconds"]), state["averages"])


def load_average(folder: Path, policy: nn.Module) -> None:
    """Restore the average that `save_progress` wrote, in place, where a state was saved.

    Raises:
        DataError: The file is damaged.
    """
    path = folder / RESUME_NAME
    if path.exists():
        fill(policy, _below(_AVERAGE, load_tensors(path)), path)


def saved_step(folder: Path) -> int | None:
    """The step of the state that `save_progress` wrote, or None where there is none.

    Raises:
        DataError: The file is damaged.
    """
    path = folder / RESUME_NAME
    return int(_read_state(path)["step"]) if path.exists() else None


def require_same_training(path: Path, found: object, fingerprint: str) -> None:
    """Refuse the files of another training.

    Raises:
        DataError: The fingerprints differ.
    """
    if found != fingerprint:
        raise DataError(
            f"{path}: of a training with another config, seed, data, prior or machine setting", _START_OVER
        )


def _read_state(path: Path) -> dict[str, Any]:
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
        if metadata.get("format") != _FORMAT:
            raise DataError(f"{path}: not a training's state", _START_OVER)
        state: dict[str, Any] = json.loads(metadata["state"])
    except (SafetensorError, OSError, ValueError, KeyError) as error:
        raise DataError(f"{path}: not readable as a training's state ({error})", _START_OVER) from error
    return state


def _below(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}


def _laid_out(value: Tensor, parameter: nn.Parameter) -> Tensor:
    """In the memory layout of the parameter: the fused optimiser walks both side by side."""
    if value.shape != parameter.shape:
        return value.to(parameter.device)
    return torch.empty_like(parameter, memory_format=torch.preserve_format).detach().copy_(value)
