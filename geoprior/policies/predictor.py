"""A trained policy with its normalisation, for rollouts: NumPy in, NumPy out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
import torch

from geoprior.episode import POSE_SIZE
from geoprior.errors import DataError
from geoprior.policies.halves import halve
from geoprior.policies.normalise import Normaliser, normalise_images

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import nn

    from geoprior.policies.policy import Features, Policy


class LoadedPredictor:
    """See `geoprior.policies.policy.Predictor`.

    The network sees the whole batch at once. Kernels of another batch size round differently: who needs the
    same bits keeps to one size, and to one row for each trial.

    Args:
        policy: In any mode; it is put into evaluation mode.
        features: What it sees and says.
        fps: Actions a second.
        normaliser: With the checkpoint's statistics.
        half: Compute in bfloat16; the policy's large weights are rounded for good.
    """

    def __init__(
        self,
        policy: nn.Module,
        features: Features,
        fps: float,
        normaliser: Normaliser,
        *,
        half: bool = False,
    ) -> None:
        if half:
            halve(policy)
        self.features = features
        self.fps = fps
        self._half = half
        self._policy = cast("Policy", policy.eval())
        self._normaliser = normaliser

    def predict(
        self, pose: NDArray[np.float32], images: Mapping[str, NDArray[np.uint8]]
    ) -> NDArray[np.float32]:
        """See `geoprior.policies.policy.Predictor.predict`.

        Raises:
            DataError: A camera is missing or extra, or an array has another shape or type.
        """
        stacked = self._stack(pose, images)
        poses = torch.from_numpy(self._normaliser.normalise("pose", pose))
        with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=self._half):
            frames = normalise_images(torch.from_numpy(stacked))
            actions = self._policy.predict({"pose": poses, "images": frames}).numpy()
        return to_commands(self._normaliser.denormalise_actions(pose, actions))

    def _stack(self, pose: NDArray[np.float32], images: Mapping[str, NDArray[np.uint8]]) -> NDArray[np.uint8]:
        if set(images) != set(self.features.cameras):
            raise DataError(
                f"the policy looks through the cameras {', '.join(self.features.cameras)}; "
                f"it was given {', '.join(sorted(images))}"
            )
        if pose.ndim != 2 or pose.shape[1] != self.features.pose_size or len(pose) == 0:
            raise DataError(f"pose: expected (B, {self.features.pose_size}), found {pose.shape}")
        size = (len(pose), *self.features.image_size)
        for name in self.features.cameras:
            frame = as_channels(images[name])
            if frame.dtype != np.uint8 or frame.shape not in {(*size, 1), (*size, 3)}:
                raise DataError(
                    f"camera {name!r}: expected uint8 {size}, alone or with three channels, "
                    f"found {frame.dtype} {images[name].shape}"
                )
        return stack_cameras(images, self.features.cameras)


def stack_cameras(frames: Mapping[str, NDArray[np.uint8]], cameras: Sequence[str]) -> NDArray[np.uint8]:
    """Frames of several cameras as one array: in training and in prediction the same.

    Args:
        frames: Per camera (B, H, W) binary or gray, or (B, H, W, 3) RGB.
        cameras: Names, in the order of the batch.

    Returns:
        (B, cameras, H, W, C) uint8; C is 1 if no camera is RGB, else 3.
    """
    columns = [as_channels(frames[camera]) for camera in cameras]
    channels = max(column.shape[-1] for column in columns)
    return np.stack([np.broadcast_to(c, (*c.shape[:-1], channels)) for c in columns], axis=1)


def as_channels(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(B, H, W) binary or gray, or (B, H, W, 3) RGB frames with an axis of channels in any case."""
    return frames[..., None] if frames.ndim == 3 else frames


def to_commands(actions: NDArray[np.float32]) -> NDArray[np.float32]:
    """Make predicted actions obey the pose contract.

    Args:
        actions: (..., 8 x hands) as a network says them.

    Returns:
        The same shape: quaternions of unit length, gripper 0 or 1. An action that is not finite is NaN in all
        its numbers.
    """
    by_hand = actions.reshape(*actions.shape[:-1], -1, POSE_SIZE).astype(np.float64)
    quaternions = by_hand[..., 3:7]
    norms = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    by_hand[..., 3:7] = quaternions / np.maximum(norms, 1e-9)
    by_hand[..., 7] = by_hand[..., 7] > 0.5
    by_hand[~np.isfinite(actions).all(axis=-1)] = np.nan
    return by_hand.reshape(actions.shape).astype(np.float32)
