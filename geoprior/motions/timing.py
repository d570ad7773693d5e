"""How the phases of a motion share its steps; for motions of others too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from geoprior.errors import ConfigError
from geoprior.geometry.seeding import child
from geoprior.options import Options
from geoprior.scene.ranges import ShareRange, uniform


class EaseOptions(Options):
    """How a motion runs through its phases."""

    later = frozenset({"ease"})

    ease: ShareRange = Field(
        (0.0, 0.0),
        description="From 0, a constant speed in each phase, to 1, a smooth start and stop (minimum jerk).",
    )

    def draw_ease(self, rng: np.random.Generator) -> float:
        """Draw an episode's share from a generator of its own, named under ``rng``."""
        return uniform(child(rng, "ease"), self.ease)


class PhaseOptions(Options):
    """Options of a motion in two phases."""

    approach: float = Field(
        0.5, gt=0.0, lt=1.0, description="Share of the steps until the hand is at the object."
    )


def ramp(count: int) -> NDArray[np.float64]:
    """(count,) times from 0 to 1, both among them; a single time is 1."""
    return np.linspace(0.0, 1.0, count) if count > 1 else np.ones(count)


def ramp_after(count: int) -> NDArray[np.float64]:
    """(count,) times from just after 0 to 1: of a phase that goes on from where another ended."""
    return np.linspace(0.0, 1.0, count + 1)[1:]


def eased(times: NDArray[np.float64], ease: float) -> NDArray[np.float64]:
    """Times (N,) in [0, 1], from a constant speed at ease 0 to minimum jerk at 1 (Flash and Hogan 1985)."""
    smooth = times**3 * (10.0 - 15.0 * times + 6.0 * times**2)
    return (1.0 - ease) * times + ease * smooth if ease else times


def approach_steps(motion: str, steps: int, share: float, reserved: int) -> int:
    """Steps of the first phase: its share of ``steps``, two at least and all but ``reserved`` at most.

    Raises:
        ConfigError: There are too few steps.
    """
    most = steps - reserved
    if most < 2:
        raise ConfigError(
            f"motion {motion!r}: {steps} steps are too few, it needs {reserved + 2}",
            "raise generate.fps or generate.seconds, or lower the motion's hold steps",
        )
    return min(max(2, round(share * steps)), most)


def shared_out(motion: str, steps: int, shares: Sequence[float]) -> list[int]:
    """Share time steps out among phases, each at least two.

    Raises:
        ConfigError: There are too few steps.
    """
    ends = np.round(np.cumsum(shares) / np.sum(shares) * steps).astype(int)
    counts: list[int] = np.diff(ends, prepend=0).tolist()
    if min(counts) < 2:
        raise ConfigError(
            f"motion {motion!r}: {steps} steps are too few for phases of {counts}",
            "raise generate.fps or generate.seconds, or even out the motion's shares",
        )
    return counts
