"""Checkpoints: ``epoch-000256.safetensors`` holds the weights, the JSON beside it all the rest.

The weights are written first and their digest stands in the JSON: a pair is whole, or it is refused.
Nothing is pickled, and nothing but the pair is needed to run the policy.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from pydantic import BaseModel, Field, JsonValue, ValidationError

from geoprior import __version__
from geoprior.errors import ConfigError, DataError
from geoprior.files import read_json, sha256_file, write_json
from geoprior.hooks.manager import plugins
from geoprior.options import Choice, Options
from geoprior.policies.normalise import (
    IMAGE_MEAN,
    IMAGE_STD,
    STD_FLOOR,
    Normaliser,
    Statistics,
    statistics_from_json,
    statistics_to_json,
)
from geoprior.policies.policy import ActionKind, Features
from geoprior.policies.predictor import LoadedPredictor
from geoprior.policies.tensors import fill, load_tensors, save_tensors

if TYPE_CHECKING:
    from torch import Tensor, nn

    from geoprior.policies.policy import Policy

FORMAT = "geoprior-checkpoint"
FORMAT_VERSION = 2
Part = Literal["all", "trunk"]
_Pixels = Annotated[int, Field(ge=1, le=16_384)]
_NAME = re.compile(r"epoch-(\d{6,})\.safetensors")
_NORMALISATION = {"std_floor": STD_FLOOR, "image_mean": list(IMAGE_MEAN), "image_std": list(IMAGE_STD)}
_TRAIN_AGAIN = "delete it and run the same command again"
_WHERE = "give an epoch-*.safetensors from RUN/checkpoints/pretrain or RUN/checkpoints/finetune/*"


@dataclass(frozen=True)
class Checkpoint:
    """One checkpoint on disk: the path of its weights, and the epoch in its name."""

    path: Path
    epoch: int


@dataclass(frozen=True)
class CheckpointHeader:
    """What the JSON of a checkpoint says.

    Attributes:
        policy: The policy's name and all its options.
        features: What it sees and says.
        fps: Actions a second, the policy's own rate.
        statistics: Of poses and actions.
        epoch: Passes over the episodes, each giving one random time step.
        step: Optimiser steps.
        details: All else that was recorded: config, data digest, seed, precision, transfer.
    """

    policy: Choice
    features: Features
    fps: float
    statistics: Statistics
    epoch: int
    step: int
    details: Mapping[str, Any]

    @property
    def actions(self) -> ActionKind:
        """How it says positions; checkpoints of before there was a choice are `absolute`."""
        return "relative" if self.policy.options.get("actions") == "relative" else "absolute"

    @property
    def normaliser(self) -> Normaliser:
        """Of its statistics, for actions of its kind.

        Raises:
            DataError: A feature lacks statistics.
        """
        return Normaliser(self.statistics, actions=self.actions)

    @property
    def data(self) -> str | None:
        """Digest of what it was trained on, where the details say so."""
        data = self.details.get("data")
        return data.get("digest") if isinstance(data, Mapping) else None


def checkpoint_path(folder: Path, epoch: int) -> Path:
    """Where the weights of an epoch lie."""
    return folder / f"epoch-{epoch:06d}.safetensors"


def list_checkpoints(folder: Path) -> tuple[Checkpoint, ...]:
    """The complete checkpoints of a training, by epoch; one without its JSON was cut off and is left out."""
    paths = folder.glob("epoch-*.safetensors") if folder.is_dir() else ()
    found = [(match, path) for path in paths if (match := _NAME.fullmatch(path.name))]
    whole = [Checkpoint(path, int(match[1])) for match, path in found if path.with_suffix(".json").exists()]
    return tuple(sorted(whole, key=lambda checkpoint: checkpoint.epoch))


def lasting_tensors(policy: nn.Module) -> dict[str, Tensor]:
    """The state dict of a policy without what serves its training alone."""
    passing: tuple[str, ...] = getattr(policy, "training_only_prefixes", ())
    return {name: tensor for name, tensor in policy.state_dict().items() if not name.startswith(passing)}


def save_checkpoint(path: Path, tensors: Mapping[str, Tensor], header: CheckpointHeader) -> None:
    """Write the pair, each file atomically, the JSON last.

    Raises:
        DataError: The folder cannot be written.
    """
    save_tensors(path, tensors, {"format": FORMAT})
    tree = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "geoprior": __version__,
        "policy": header.policy.model_dump(mode="json"),
        "features": {key: value for key, value in asdict(header.features).items() if key != "targets"},
        "fps": header.fps,
        "statistics": statistics_to_json(header.statistics),
        "normalisation": _NORMALISATION,
        "epoch": header.epoch,
        "step": header.step,
        "details": dict(header.details),
        "weights": {"bytes": path.stat().st_size, "sha256": sha256_file(path)},
    }
    write_json(path.with_suffix(".json"), tree)


def load_checkpoint(path: Path) -> tuple[CheckpointHeader, dict[str, Tensor]]:
    """Read and verify a pair.

    Args:
        path: Of the ``.safetensors`` file.

    Raises:
        DataError: A file is missing, cut off, foreign, or of another format version; it is named.
    """
    header, weights = _read_header(path)
    if not path.is_file():
        raise DataError(f"{path}: no such checkpoint", "run the training again")
    if path.stat().st_size != weights["bytes"] or sha256_file(path) != weights["sha256"]:
        raise DataError(f"{path}: not the weights that its JSON describes: cut off or changed", _TRAIN_AGAIN)
    return header, load_tensors(path)


def weights_digest(path: Path) -> str:
    """The SHA-256 of the weights as their JSON has it, in hexadecimal; the weights are not read.

    Raises:
        DataError: The JSON is missing, damaged or foreign.
    """
    return str(_read_header(path)[1]["sha256"])


def read_header(path: Path) -> CheckpointHeader:
    """Read a checkpoint's JSON only; see `load_checkpoint`."""
    return _read_header(path)[0]


def _read_header(path: Path) -> tuple[CheckpointHeader, Mapping[str, Any]]:
    file = path.with_suffix(".json")
    if path.suffix != ".safetensors":
        raise DataError(f"{path}: not a checkpoint of geoprior", _WHERE)
    if not file.is_file():
        if not path.is_file():
            raise DataError(f"{path}: no such checkpoint", _WHERE)
        raise DataError(
            f"{path}: {file.name} does not lie beside it: not one of geoprior, or half-written",
            "weights of other software have no such file and cannot be read; copy both, or train again",
        )
    tree = read_json(file)
    if not isinstance(tree, dict) or tree.get("format") != FORMAT:
        raise DataError(f"{file}: not a checkpoint of geoprior", _WHERE)
    if tree.get("format_version") != FORMAT_VERSION:
        raise DataError(
            f"{file}: checkpoint format {tree.get('format_version')}, this geoprior reads {FORMAT_VERSION}",
            f"use the version that wrote it ({tree.get('geoprior')})",
        )
    if tree.get("normalisation") != _NORMALISATION:
        raise DataError(
            f"{file}: key 'normalisation': {tree.get('normalisation')}, expected {_NORMALISATION}",
            "use the version of geoprior that wrote it",
        )
    try:
        return _parse(_Tree.model_validate(tree)), tree["weights"]
    except ValueError as error:
        raise DataError(f"{file}: key missing or malformed: {_plain(error)}", _TRAIN_AGAIN) from error


def _plain(error: ValueError) -> str:
    if not isinstance(error, ValidationError):
        return str(error)
    first = error.errors(include_url=False)[0]
    return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"


class _Features(Options):
    """`Features` as a stranger's JSON has them."""

    cameras: tuple[str, ...] = Field(min_length=1, max_length=64)
    image_size: tuple[_Pixels, _Pixels]
    hands: tuple[str, ...] = Field(min_length=1, max_length=64)
    chunk: int = Field(ge=1, le=1000)


class _Weights(Options):
    """The file beside it."""

    bytes: int = Field(ge=0)
    sha256: str = Field(pattern="^[0-9a-f]{64}$")


class _Tree(BaseModel):
    """What a stranger's JSON must have; what else it has is not looked at."""

    policy: Choice
    features: _Features
    fps: float = Field(gt=0.0, le=10_000.0)
    statistics: dict[str, Any]
    epoch: int = Field(ge=0)
    step: int = Field(ge=0)
    details: dict[str, JsonValue]
    weights: _Weights


def _parse(tree: _Tree) -> CheckpointHeader:
    features = Features(**dict(tree.features))
    return CheckpointHeader(
        policy=tree.policy,
        features=features,
        fps=tree.fps,
        statistics=statistics_from_json(tree.statistics, features.pose_size),
        epoch=tree.epoch,
        step=tree.step,
        details=tree.details,
    )


def load_weights(policy: nn.Module, path: Path, which: Part = "all") -> tuple[str, ...]:
    """Put a checkpoint's weights into a policy, strictly within the part that is taken.

    Args:
        policy: A `geoprior.policies.policy.Policy`, built with the sizes it shall have.
        path: Of the checkpoint.
        which: All tensors, or only those of the visual trunk.

    Returns:
        Names of the tensors taken.

    Raises:
        DataError: A camera or a hand is named otherwise, or a tensor is missing, extra or of another shape.
        ConfigError: The trunk's are wanted and the policy has none.
    """
    header, tensors = load_checkpoint(path)
    ours = cast("Policy", policy)
    if which == "trunk":
        if not ours.trunk_prefixes:
            raise ConfigError(
                f"policy {header.policy.name!r} has no trunk, so nothing would be taken of {path}",
                "set the condition's weights to all",
            )
        taken = {name: tensor for name, tensor in tensors.items() if name.startswith(ours.trunk_prefixes)}
        return fill(policy, taken, path, ours.trunk_prefixes)
    for what in ("cameras", "hands"):
        theirs, these = getattr(header.features, what), getattr(ours.features, what)
        if theirs != these:
            raise DataError(
                f"{path}: trained on the {what} {', '.join(theirs)}, this data has {', '.join(these)}",
                f"rename the {what} of the data, or take the trunk's weights only",
            )
    return fill(policy, tensors, path)


def load_half_predictor(path: Path) -> LoadedPredictor:
    """`load_predictor`, computing in bfloat16."""
    return load_predictor(path, half=True)


def load_predictor(path: Path, *, half: bool = False) -> LoadedPredictor:
    """Load a checkpoint for rollouts; see `geoprior.policies.policy.Predictor`.

    Args:
        path: Of the ``.safetensors`` file.
        half: Compute in bfloat16 instead of float32.

    Raises:
        DataError: The pair is missing, damaged or foreign, or does not fit its own description.
        ConfigError: The policy is of a plug-in that is not installed.
    """
    header, tensors = load_checkpoint(path)
    normaliser = header.normaliser
    policy: nn.Module = plugins().build("policy", header.policy, header.features)
    fill(policy, tensors, path)
    return LoadedPredictor(policy, header.features, header.fps, normaliser, half=half)
