"""What a caption says of an episode and of a step."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from geoprior.episode import POSE_SIZE
from geoprior.scene.hand import HAND

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.episode import EpisodeHeader


def episode_caption(header: EpisodeHeader) -> str:
    """One line: key, motion, what it is made with, length."""
    primitive = header.details.get("primitive")
    shape = primitive.get("name") if isinstance(primitive, dict) else None
    what = f"{header.motion} a {shape}" if shape else header.motion
    return line_of([header.key, what, header.source, f"{header.steps} steps at {header.fps:g} Hz"])


def step_caption(header: EpisodeHeader, pose: NDArray[np.float32], step: int) -> tuple[str, str, str]:
    """Three short lines: step and time; phase, empty if the episode does not tell it; the grippers' states.

    Args:
        header: Of the episode.
        pose: (N, 8 x hands).
        step: Which one.
    """
    grippers = pose[step].reshape(-1, POSE_SIZE)[:, 7]
    states = [
        ("" if hand == HAND else f"{hand} ") + ("closed" if value else "open")
        for hand, value in zip(header.hands, grippers, strict=True)
    ]
    return f"{step}  ·  {step / header.fps:.1f} s", phase_of(header, step), "  ".join(states)


def line_of(words: Iterable[str]) -> str:
    """Words that are not empty, on one line."""
    return "  ·  ".join(word for word in words if word)


def phase_of(header: EpisodeHeader, step: int) -> str:
    """Name of a step's phase, from ``details["phases"]``: pairs of name and number of steps; else empty."""
    phases: Any = header.details.get("phases")
    if not isinstance(phases, list):
        return ""
    for pair in phases:
        match pair:
            case [str(name), int(steps)] if step < steps:
                return name
            case [str(), int(steps)]:
                step -= steps
            case _:
                return ""
    return ""
