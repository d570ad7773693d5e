"""What a training is judged by at its checkpoints. Light: importing it imports no torch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from torch import nn

    from geoprior.policies.normalise import Normaliser
    from geoprior.policies.policy import Features
    from geoprior.sources.source import Source
    from geoprior.training.machine import Machine


VISION_GAIN = "vision_gain"
"""What a judge names the gain of seeing the right images, in normalised L1."""


def has_vision_gain(wanted: float, judged: Mapping[str, float]) -> bool:
    """Whether the gain is as large as wanted; never where no judge measures it."""
    return judged.get(VISION_GAIN, 0.0) >= wanted


class Judge(Protocol):
    """Measures a policy; `geoprior.training.held_out.HeldOut` is one."""

    def measure(self, policy: nn.Module, machine: Machine) -> dict[str, float]:
        """Numbers to log, by names that no other judge of the training gives.

        Called in the leading process, within `geoprior.training.machine.arithmetic`. It may put the policy
        into evaluation mode and back; weights, buffers and the order of samples stay as they are. What it
        draws from torch's generator does not matter: every step seeds it anew.

        Args:
            policy: A `geoprior.policies.policy.Policy` on the machine's device, in training mode.
            machine: Precision and device.
        """
        ...


@dataclass(frozen=True)
class Taught:
    """What a training learns from, for judges that compare with it.

    Attributes:
        source: Its episodes.
        slots: Those that it is trained on.
        features: Of the policy.
        normaliser: Of its poses and actions.
        skip: Steps of the episodes in one of the policy's.
    """

    source: Source
    slots: Sequence[int]
    features: Features
    normaliser: Normaliser
    skip: int


JudgeMaker = Callable[[Taught], Judge]
"""Makes a judge of one training."""
