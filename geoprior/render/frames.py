"""What a renderer says that it draws, held to it; see `geoprior.episode.FrameFormat`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoprior.episode import KINDS, FrameFormat
from geoprior.errors import PluginError
from geoprior.render.packing import unpack_frames

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.episode import FrameKind
    from geoprior.hooks.types import Renderer
    from geoprior.render.clouds import Shot


def frame_kind(renderer: Renderer, name: str = "") -> FrameKind:
    """What a renderer says that it draws.

    Args:
        renderer: See `geoprior.hooks.types.Renderer`.
        name: That a config gives it; the name of its class if empty.

    Raises:
        PluginError: It says nothing, or nothing that is known.
    """
    kind: FrameKind | None = getattr(renderer, "frames", None)
    if kind not in KINDS:
        raise PluginError(
            f"renderer {name or type(renderer).__name__!r}: its `frames` is {kind!r}, "
            f"expected one of {', '.join(map(repr, KINDS))}",
            'say what it draws: `frames: ClassVar[FrameKind] = "gray"`, see geoprior.episode',
        )
    return kind


def draw(renderer: Renderer, shot: Shot, name: str = "") -> NDArray[np.uint8]:
    """Draw the frames of a shot, and check that they are what the renderer says.

    Args:
        renderer: See `geoprior.hooks.types.Renderer`.
        shot: What to draw.
        name: See `frame_kind`.

    Returns:
        (N, `FrameFormat.drawn_shape`) uint8.

    Raises:
        PluginError: They have another shape or type.
    """
    kind = frame_kind(renderer, name)
    frames = renderer.render(shot)
    expected = (shot.steps, *FrameFormat(kind, shot.view.height, shot.view.width).drawn_shape)
    if not isinstance(frames, np.ndarray) or frames.dtype != np.uint8 or frames.shape != expected:
        found = f"{getattr(frames, 'dtype', type(frames).__name__)} {getattr(frames, 'shape', '')}".strip()
        raise PluginError(
            f"renderer {name or type(renderer).__name__!r}: draws {kind} frames of {shot.view.height} x "
            f"{shot.view.width} pixels: expected uint8 {expected}, found {found}",
            "give frames as `geoprior.hooks.types.Renderer` says, or another `frames`; "
            "`geoprior plugins check` finds more",
        )
    return frames


def unpacked(kind: FrameKind, frames: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """Frames as a renderer draws them, as they are trained on.

    Args:
        kind: What they are.
        frames: (N, `FrameFormat.drawn_shape`).
        width: W.

    Returns:
        (N, H, W) uint8, of binary frames 0 or 255; or (N, H, W, 3).
    """
    return unpack_frames(frames, width) if kind == "binary" else frames
