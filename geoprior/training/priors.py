"""Which checkpoint a condition takes weights or statistics from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from geoprior.errors import ConfigError, DataError
from geoprior.policies.checkpoint import list_checkpoints, weights_digest

if TYPE_CHECKING:
    from collections.abc import Mapping

    from geoprior.training.config import ConditionConfig

BLIND = "blind"
"""Below the folder of pretraining: the prior that was trained on black images."""
_IN_A_RUN = "checkpoints/pretrain"


def find_prior(name: str, condition: ConditionConfig, own: Path | None) -> Path | None:
    """The checkpoint that a condition takes something from, or None where it takes nothing.

    Args:
        name: Of the condition.
        condition: How it begins.
        own: Folder of the run's pretraining, if there is one.

    Raises:
        ConfigError: There is no prior.
        DataError: Where it should be there is no checkpoint.
    """
    if not condition.takes_from_a_prior:
        return None
    if condition.prior is not None:
        return find_outside(name, condition.prior)
    if own is None:
        raise ConfigError(
            f"condition {name!r} begins from a prior and none is given", "run `geoprior pretrain`"
        )
    return last_checkpoint(own / BLIND if condition.init == "blind-prior" else own)


def last_checkpoint(folder: Path) -> Path:
    """The last checkpoint of a training.

    Raises:
        DataError: Its folder holds none.
    """
    checkpoints = list_checkpoints(folder)
    if not checkpoints:
        raise DataError(f"{folder}: no checkpoint of pretraining is here", "run `geoprior pretrain`")
    return checkpoints[-1].path


def find_outside(name: str, said: str) -> Path:
    """The checkpoint that a condition's ``prior`` names.

    Args:
        name: Of the condition.
        said: A checkpoint, a folder of checkpoints, or a run folder; of folders the last checkpoint is taken.

    Raises:
        DataError: There is none; what is there may be damaged all the same.
    """
    path = Path(said)
    if path.is_file():
        return path
    for folder in (path, path / _IN_A_RUN):
        if found := list_checkpoints(folder):
            return found[-1].path
    state = "holds no checkpoint of a prior" if path.is_dir() else "no such file or folder"
    raise DataError(
        f"finetune.conditions.{name}.prior: {path}: {state}",
        "give an epoch-*.safetensors with its JSON beside it, a folder of them, or a run folder whose "
        "pretraining is done",
    )


def outside_digests(conditions: Mapping[str, ConditionConfig]) -> dict[str, str]:
    """SHA-256 of the weights of every prior from outside the run, by condition; no path enters.

    Raises:
        DataError: One is missing, damaged or foreign.
    """
    return {
        name: weights_digest(find_outside(name, condition.prior))
        for name, condition in conditions.items()
        if condition.prior is not None
    }
