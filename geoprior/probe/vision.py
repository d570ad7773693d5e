"""What looking is worth to a policy: its error with the right images, with others' and with none."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import numpy as np
import torch

from geoprior.policies.normalise import normalise_images
from geoprior.policies.predictor import stack_cameras
from geoprior.probe.baselines import (
    Lessons,
    fit_pose_only,
    lessons_of_rows,
    predict_by_others,
    predict_pose_only,
    stand_still,
)
from geoprior.probe.episodes import rows_of
from geoprior.probe.sight import ALL, Sight

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor, nn

    from geoprior.policies.normalise import Normaliser
    from geoprior.policies.policy import Features, Policy
    from geoprior.probe.episodes import ProbeEpisodes
    from geoprior.training.machine import Machine

    FloatArray = NDArray[np.float64]
    Predict = Callable[[Tensor, Tensor], Tensor]

BATCH = 48


class VisionProbe:
    """Measures policies on the same moments of the same episodes.

    Args:
        episodes: To measure on.
        features: Of the policies.
        normaliser: Of the policies' training.
        skip: Steps of the episodes in one of the policies'.
        lessons: What the pose-only regressor is fitted on; by default, for each fifth of the episodes, the
            other four fifths.

    Raises:
        DataError: A motion has one episode only.
    """

    def __init__(
        self,
        episodes: ProbeEpisodes,
        features: Features,
        normaliser: Normaliser,
        skip: int = 1,
        lessons: Lessons | None = None,
    ) -> None:
        self.episodes, self.features = episodes, features
        self.rows = rows_of(episodes, features, skip)
        asked = lessons_of_rows(episodes, self.rows, normaliser)
        self.poses = torch.from_numpy(asked.pose.astype(np.float32))
        self._target, self._valid = asked.action, asked.valid
        self._still = self._errors(stand_still(episodes, self.rows, normaliser))
        self._pose_only = self._errors(
            predict_by_others(asked, self.rows.episodes)
            if lessons is None
            else predict_pose_only(fit_pose_only(lessons), asked.pose)
        )

    def measure(self, policy: nn.Module, machine: Machine, *, black: bool = False) -> dict[str, Sight]:
        """By motion, and for all of them together as ``all``, which stands first.

        Args:
            policy: On the machine's device; it is in the mode that it was in when this returns.
            machine: Device and precision.
            black: Whether to measure with black images too.
        """
        own = np.arange(len(self.rows))
        errors = {
            "true": self._errors(self.predict(policy, machine, own)),
            "shuffled": self._errors(self.predict(policy, machine, self.rows.partners)),
        }
        if black:
            errors["black"] = self._errors(self.predict(policy, machine, None))
        errors |= {"still": self._still, "pose_only": self._pose_only}
        names = np.array(self.episodes.motions)
        everything = {ALL: np.ones(len(names), bool)}
        parts = {name: names == name for name in sorted(set(self.episodes.motions))}
        return {name: _sight(errors, members) for name, members in (everything | parts).items()}

    def predict(self, policy: nn.Module, machine: Machine, images: NDArray[np.int64] | None) -> FloatArray:
        """(M, chunk, pose_size) normalised actions at every moment.

        Args:
            policy: See `measure`.
            machine: See `measure`.
            images: (M,) the moments whose images are shown; None shows black ones.
        """
        ours = cast("Policy", policy)
        parts = self.each_batch(
            policy, machine, images, lambda pose, seen: ours.predict({"pose": pose, "images": seen})
        )
        return np.concatenate(parts)

    def each_batch(
        self, policy: nn.Module, machine: Machine, images: NDArray[np.int64] | None, ask: Predict
    ) -> list[FloatArray]:
        """Answers to poses and images, in evaluation mode; every batch has the same size, the last is cut."""
        was_training = policy.training
        policy.eval()
        count, size = len(self.rows), min(BATCH, len(self.rows))
        parts = []
        try:
            for first in range(0, count, size):
                rows = np.minimum(np.arange(first, first + size), count - 1)
                frames = self._frames(rows if images is None else images[rows], black=images is None)
                seen = normalise_images(torch.from_numpy(frames)).to(machine.device)
                half = machine.precision == "bf16"
                with torch.no_grad(), torch.autocast(machine.device, torch.bfloat16, enabled=half):
                    answer = ask(self.poses[rows].to(machine.device), seen)
                parts.append(answer[: count - first].double().cpu().numpy())
        finally:
            policy.train(was_training)
        return parts

    def _frames(self, rows: NDArray[np.int64], *, black: bool) -> NDArray[np.uint8]:
        """(B, cameras, H, W, C) uint8."""
        cameras = self.features.cameras
        if black:
            return np.zeros((len(rows), len(cameras), *self.features.image_size, 1), np.uint8)
        moments = self.episodes.source.read(self.rows.slots[rows], self.rows.steps[rows, :1])
        return stack_cameras(moments.frames, cameras)

    def _errors(self, predicted: FloatArray) -> FloatArray:
        """(E,) of each episode: the mean over its moments of the mean over a moment's valid actions."""
        wrong = np.abs(predicted - self._target).mean(axis=2) * self._valid
        by_moment = wrong.sum(axis=1) / self._valid.sum(axis=1)
        return np.asarray(by_moment.reshape(len(self.episodes), -1).mean(axis=1))


def _sight(errors: dict[str, FloatArray], members: NDArray[np.bool_]) -> Sight:
    gain = (errors["shuffled"] - errors["true"])[members]
    means = {name: float(values[members].mean()) for name, values in errors.items()}
    return Sight(
        **{"black": None, **means},  # type: ignore[arg-type]
        vision_gain=float(gain.mean()),
        vision_gain_se=float(gain.std(ddof=1) / np.sqrt(len(gain))),
    )
