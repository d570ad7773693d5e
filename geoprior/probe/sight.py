"""What is measured of a policy's sight, its names in logs, and what it says. Light: no torch, no NumPy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

ALL = "all"
"""Stands for all motions together."""
CLEARLY = 2.0
"""Standard errors by which a gain must be above zero."""
BARELY = 0.05
"""Share of the shuffled error below which a gain is small, however sure."""
REMEDY = (
    "train longer (pretrain.epochs), or on data that cannot be solved blind; docs/prior.md says how to tell "
    "and what helped"
)
_LOGGED = {
    "true": "true_l1",
    "shuffled": "shuffled_l1",
    "black": "black_l1",
    "still": "still_l1",
    "pose_only": "pose_only_l1",
    "vision_gain": "vision_gain",
    "vision_gain_se": "vision_gain_se",
}


@dataclass(frozen=True)
class Sight:
    """Mean errors over some episodes, each episode counting alike: normalised L1 of the valid actions.

    Attributes:
        true: With the images as they are.
        shuffled: With those of another episode of the same motion, at a like time; the pose is kept.
        black: With black ones; None where that was not measured.
        still: Of repeating the present pose.
        pose_only: Of a ridge regression on the pose alone.
        vision_gain: ``shuffled`` less ``true``: what looking is worth.
        vision_gain_se: Its standard error over the episodes.
    """

    true: float
    shuffled: float
    black: float | None
    still: float
    pose_only: float
    vision_gain: float
    vision_gain_se: float

    @property
    def sees(self) -> bool:
        """Whether the gain is clearly above zero."""
        return self.vision_gain > CLEARLY * self.vision_gain_se

    @property
    def baseline(self) -> tuple[str, float]:
        """The better baseline, by name, and its error."""
        return min(("standing still", self.still), ("the pose alone", self.pose_only), key=lambda one: one[1])


def as_metrics(measured: Mapping[str, Sight]) -> dict[str, float]:
    """Flat names for a log: ``vision_gain``, ``true_l1``; of one motion ``vision_gain_pick``."""
    return {
        f"{_LOGGED[name]}{'' if motion == ALL else f'_{motion}'}": value
        for motion, sight in measured.items()
        for name, value in asdict(sight).items()
        if value is not None
    }


def from_metrics(metrics: Mapping[str, Any]) -> dict[str, Sight]:
    """The inverse of `as_metrics`, among whatever else was logged; empty where nothing of it was."""
    lead = _LOGGED["true"]
    suffixes = [name.removeprefix(lead) for name in metrics if name == lead or name.startswith(f"{lead}_")]
    found = {}
    for suffix in sorted(suffixes):
        values = {name: metrics.get(f"{logged}{suffix}") for name, logged in _LOGGED.items()}
        if all(isinstance(value, int | float) for name, value in values.items() if name != "black"):
            found[suffix.removeprefix("_") or ALL] = Sight(**values)  # type: ignore[arg-type]
    return found


def judgement(sight: Sight) -> str:
    """One plain sentence: whether a policy looks, and whether that beats not looking."""
    name, error = sight.baseline
    numbers = (
        f"its error is {sight.true:.3f} with the right images and {sight.shuffled:.3f} with another episode's"
    )
    if not sight.sees:
        return f"This policy does not look: {numbers}, which is no clear difference."
    barely = "barely " if sight.vision_gain < BARELY * sight.shuffled else ""
    looks = f"This policy {barely}looks: {numbers}"
    if sight.true >= error:
        return f"{looks}, yet {name} does better without looking ({error:.3f})."
    return f"{looks}; the better of the two ways of not looking, {name}, makes {error:.3f}."


def warning(measured: Mapping[str, Sight]) -> str:
    """What is wrong with a prior's sight, in a sentence; empty where nothing is, or nothing was measured."""
    if ALL not in measured:
        return ""
    sight = measured[ALL]
    name, error = sight.baseline
    faults = []
    if not sight.sees:
        faults.append(
            f"its error is {sight.true:.3f} with the right images and {sight.shuffled:.3f} with another "
            f"episode's (gain {sight.vision_gain:.3f}, standard error {sight.vision_gain_se:.3f}): it "
            "does not look"
        )
    if sight.true >= error:
        faults.append(f"its error of {sight.true:.3f} is not below that of {name}, {error:.3f}")
    return f"the prior may be blind: {'; '.join(faults)}" if faults else ""
