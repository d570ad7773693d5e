"""Normalisation: statistics of poses and actions, and the fixed scaling of frames.

The statistics travel in the checkpoint, and what has none is an error: a feature that passes through
unchanged trains to a policy that fails in silence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from pydantic import NonNegativeFloat, PositiveInt, TypeAdapter

from geoprior.episode import POSE_FIELDS, POSE_SIZE
from geoprior.errors import DataError
from geoprior.lanes import in_lanes, numbers_of
from geoprior.options import Options

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    from geoprior.policies.policy import ActionKind

STD_FLOOR = 1e-2
"""Smallest standard deviation that is divided by: a constant channel must not amplify noise."""
IMAGE_MEAN = (0.485, 0.456, 0.406)
IMAGE_STD = (0.229, 0.224, 0.225)
"""Of ImageNet's RGB in [0, 1]: what a torchvision trunk expects."""
_IMAGE_SCALE = torch.tensor([1.0 / (255.0 * std) for std in IMAGE_STD])
_IMAGE_SHIFT = torch.tensor([-mean / std for mean, std in zip(IMAGE_MEAN, IMAGE_STD, strict=True)])
NORMALISED_FEATURES = ("pose", "action")
_IS_POSITION = np.array([field in {"x", "y", "z"} for field in POSE_FIELDS])


@dataclass(frozen=True)
class FeatureStatistics:
    """Mean and standard deviation of each channel of a feature, over ``count`` time steps."""

    mean: tuple[float, ...]
    std: tuple[float, ...]
    count: int


Statistics = Mapping[str, FeatureStatistics]


def measure(rows: Sequence[NDArray[np.float32]]) -> FeatureStatistics:
    """The statistics over the rows of all arrays, each (N, channels): no more than one is in memory twice.

    Raises:
        DataError: There are no rows.
    """
    count = sum(len(row) for row in rows)
    if count == 0:
        raise DataError("there are no time steps to take statistics of")
    mean = sum(row.sum(axis=0, dtype=np.float64) for row in rows) / count
    squares = sum(np.square(row - mean).sum(axis=0) for row in rows)
    return FeatureStatistics(tuple(mean.tolist()), tuple(np.sqrt(squares / count).tolist()), count)


def merge(first: Statistics, second: Statistics) -> dict[str, FeatureStatistics]:
    """The statistics of two data sets taken together: every time step counts once.

    Raises:
        DataError: A feature has statistics in one only, or of another length.
    """
    return {name: _merge_feature(name, first, second) for name in sorted({*first, *second})}


def _merge_feature(name: str, first: Statistics, second: Statistics) -> FeatureStatistics:
    a, b = require(first, name), require(second, name)
    if len(a.mean) != len(b.mean):
        raise DataError(
            f"feature {name!r} has {len(a.mean)} channels in one data set, {len(b.mean)} in the other"
        )
    count = a.count + b.count
    mean = (np.array(a.mean) * a.count + np.array(b.mean) * b.count) / count
    squares = sum(
        part.count * (np.array(part.std) ** 2 + (np.array(part.mean) - mean) ** 2) for part in (a, b)
    )
    return FeatureStatistics(tuple(mean.tolist()), tuple(np.sqrt(squares / count).tolist()), count)


def require(statistics: Statistics, name: str) -> FeatureStatistics:
    """The statistics of one feature.

    Raises:
        DataError: There are none; the message names the feature.
    """
    if name not in statistics:
        raise DataError(
            f"feature {name!r} has no statistics, only: {', '.join(sorted(statistics)) or 'none'}",
            "the checkpoint was written by something else or edited; train again",
        )
    return statistics[name]


def statistics_to_json(statistics: Statistics) -> dict[str, Any]:
    """As the checkpoint's JSON holds them; floats survive exactly."""
    return {
        name: {"mean": list(feature.mean), "std": list(feature.std), "count": feature.count}
        for name, feature in statistics.items()
    }


class _Moments(Options):
    """`FeatureStatistics` as a stranger's JSON has them."""

    mean: tuple[float, ...]
    std: tuple[NonNegativeFloat, ...]
    count: PositiveInt


_STATISTICS = TypeAdapter(dict[str, _Moments])


def statistics_from_json(tree: Mapping[str, Any], channels: int) -> dict[str, FeatureStatistics]:
    """The inverse of `statistics_to_json`, for features of so many channels.

    Raises:
        ValueError: It is something else, or a number is not finite.
    """
    found = _STATISTICS.validate_python(tree)
    statistics = {name: FeatureStatistics(**dict(moments)) for name, moments in found.items()}
    for name, feature in statistics.items():
        if {len(feature.mean), len(feature.std)} != {channels}:
            raise ValueError(f"statistics of {name!r}: expected {channels} channels")
    return statistics


def origins(pose: NDArray[np.float32], actions: ActionKind) -> NDArray[np.float64]:
    """What the actions of a chunk are counted from.

    Relative ones are counted from the present position of each hand. Quaternions are not: their difference is
    no rotation, and hands that work over a table turn within a small range. Grippers are open or closed.

    Args:
        pose: (..., 8 x hands), where the hands are.
        actions: Of the policy.

    Returns:
        (..., 1, 8 x hands), to be taken from actions (..., chunk, 8 x hands); zero where nothing is.
    """
    counted = np.tile(_IS_POSITION, pose.shape[-1] // POSE_SIZE) & (actions == "relative")
    return np.where(counted, pose, 0.0).astype(np.float64)[..., None, :]


class Normaliser:
    """Normalises poses and actions, and undoes it.

    Args:
        statistics: Of every name in `NORMALISED_FEATURES`; of the actions as they are learned.
        std_floor: See `STD_FLOOR`.
        actions: How positions are learned.

    Raises:
        DataError: A feature lacks statistics.
    """

    def __init__(
        self, statistics: Statistics, std_floor: float = STD_FLOOR, *, actions: ActionKind = "absolute"
    ) -> None:
        self.actions = actions
        self.statistics = {name: require(statistics, name) for name in NORMALISED_FEATURES}
        self._mean = {name: np.array(feature.mean) for name, feature in self.statistics.items()}
        self._std = {
            name: np.maximum(np.array(feature.std), std_floor) for name, feature in self.statistics.items()
        }

    def normalise(self, name: str, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """(..., channels) raw to normalised float32; computed in float64."""
        normalised: NDArray[np.float32] = ((values - self._mean[name]) / self._std[name]).astype(np.float32)
        return normalised

    def denormalise(self, name: str, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """The inverse of `normalise`."""
        raw: NDArray[np.float32] = (values * self._std[name] + self._mean[name]).astype(np.float32)
        return raw

    def normalise_actions(
        self, pose: NDArray[np.float32], actions: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Poses (..., channels) and raw actions (..., chunk, channels) to what a policy learns to say."""
        return self.normalise("action", actions - origins(pose, self.actions))

    def denormalise_actions(
        self, pose: NDArray[np.float32], actions: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """The inverse of `normalise_actions`."""
        raw = actions * self._std["action"] + self._mean["action"] + origins(pose, self.actions)
        return np.asarray(raw.astype(np.float32))


def normalise_images(frames: Tensor) -> Tensor:
    """Frames as recorded to what a trunk sees.

    Args:
        frames: (..., H, W, 3) RGB, or (..., H, W, 1) binary or gray, which is repeated to three
            channels; uint8, or float32 in [0, 255] where noise has been added.

    Returns:
        (..., 3, H, W) float32, with the channels last in memory.
    """
    plain = frames.dtype in {torch.uint8, torch.float32} and not frames.requires_grad
    if not plain or not frames.is_cpu or torch.compiler.is_compiling():
        return torch.addcmul(_IMAGE_SHIFT, frames.float(), _IMAGE_SCALE).movedim(-1, -3)
    from geoprior.policies._frames_kernel import scale_frames

    scaled = torch.empty(*frames.shape[:-1], 3)
    pixels = numbers_of(frames.contiguous()).reshape(-1, frames.shape[-1])
    out = numbers_of(scaled).reshape(-1, 3)
    in_lanes(scale_frames, scaled.numel(), pixels, _IMAGE_SCALE.numpy(), _IMAGE_SHIFT.numpy(), out)
    return scaled.movedim(-1, -3)
