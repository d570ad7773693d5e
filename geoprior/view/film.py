"""Films: WebM for browsers, and GIF, animated PNG or MP4 where those are wanted."""

from __future__ import annotations

import itertools
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from PIL import Image

from geoprior.errors import ConfigError, MachineError
from geoprior.files import atomic_path
from geoprior.view.canvas import below, beside, blank, caption, enlarge, fit, framed, to_rgb
from geoprior.view.captions import episode_caption, line_of, step_caption
from geoprior.view.reduction import reduced

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.episode import Episode

    Frames = Iterator[NDArray[np.uint8]]

_STDERR = threading.Lock()
_TRACK_UID = b"\x73\xc5\x88"


def write_film(path: Path, frames: Iterable[NDArray[np.uint8]], fps: float, scale: int = 1) -> None:
    """Write frames as a film, atomically; the same frames give the same bytes on the same machine.

    Args:
        path: ``.webm`` (VP8), ``.mp4`` (MPEG-4 part 2), ``.gif`` or ``.png`` (animated).
        frames: (H, W, 3) uint8 RGB, all of one size.
        fps: Frames a second. GIF counts in hundredths of a second.
        scale: Repeat each pixel so many times along rows and columns.

    Raises:
        ConfigError: The suffix is unknown; the hint shows the choices.
        DataError: The folder cannot be written.
        MachineError: OpenCV was built without the codec.
        ValueError: There are no frames, or two differ in size.
    """
    write = _WRITERS.get(path.suffix.lower())
    if write is None:
        raise ConfigError(
            f"{path}: films of the kind {path.suffix!r} are unknown", f"choices: {', '.join(_WRITERS)}"
        )
    stream = _alike(enlarge(frame, scale) for frame in frames)
    first = next(stream, None)
    if first is None:
        raise ValueError(f"{path}: a film needs at least one frame")
    with atomic_path(path) as temporary:
        # FFmpeg takes the container from the suffix.
        film = temporary.with_name(temporary.name + path.suffix.lower())
        try:
            write(film, itertools.chain([first], stream), fps)
            film.replace(temporary)
        finally:
            film.unlink(missing_ok=True)


def episode_film(episode: Episode, cell: int = 192) -> Iterator[NDArray[np.uint8]]:
    """Yield a frame for each step: every camera side by side above a bar with phase, gripper and time.

    Args:
        episode: What to show.
        cell: Largest height of a camera's frame, in pixels.

    Yields:
        (height, width, 3) uint8 RGB.
    """
    header = episode.header
    for step in range(header.steps):
        views = beside([fit(to_rgb(episode.images[camera.name][step]), cell) for camera in header.cameras])
        lines = [episode_caption(header), line_of(step_caption(header, episode.pose, step))]
        yield framed(below([views, caption(lines, views.shape[1])]))


def _write_webm(path: Path, frames: Frames, fps: float) -> None:
    _write_video(path, frames, fps, "VP80")
    path.write_bytes(_without_random_id(path.read_bytes()))


def _write_mp4(path: Path, frames: Frames, fps: float) -> None:
    _write_video(path, frames, fps, "mp4v")


def _write_video(path: Path, frames: Frames, fps: float, codec: str) -> None:
    first = _even(next(frames))
    size = (first.shape[1], first.shape[0])
    with _quiet():
        writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), fps, size)
    if not writer.isOpened():
        raise MachineError(
            f"this OpenCV cannot write {codec} films",
            "pip install --force-reinstall opencv-python-headless, or choose .gif",
        )
    try:
        for frame in itertools.chain([first], map(_even, frames)):
            writer.write(np.ascontiguousarray(frame[..., ::-1]))
    finally:
        writer.release()


def _write_gif(path: Path, frames: Frames, fps: float) -> None:
    images = reduced(list(frames))
    images[0].save(path, save_all=True, append_images=images[1:], duration=1000.0 / fps, loop=0)


def _write_pillow(path: Path, frames: Frames, fps: float) -> None:
    # Pillow walks over the images more than once.
    images = [Image.fromarray(frame) for frame in frames]
    images[0].save(path, save_all=True, append_images=images[1:], duration=1000.0 / fps, loop=0)


_WRITERS: dict[str, Callable[[Path, Frames, float], None]] = {
    ".webm": _write_webm,
    ".mp4": _write_mp4,
    ".gif": _write_gif,
    ".png": _write_pillow,
}


def _alike(frames: Frames) -> Frames:
    """The same frames; OpenCV would leave out those of another size without a word."""
    shape = None
    for frame in frames:
        shape = shape or frame.shape
        if frame.shape != shape:
            raise ValueError(f"a film's frames are all of one size: {shape} and {frame.shape}")
        yield frame


def _even(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The frame with an even number of rows and columns, as these codecs want."""
    rows, columns = frame.shape[:2]
    if rows % 2 == 0 and columns % 2 == 0:
        return frame
    canvas = blank(rows + rows % 2, columns + columns % 2)
    canvas[:rows, :columns] = frame
    return canvas


def _without_random_id(content: bytes) -> bytes:
    """Replace the 8 random bytes by which FFmpeg names a WebM track, wherever they stand."""
    at = content.find(_TRACK_UID, 0, 4096)
    if at < 0:
        return content
    begin = at + len(_TRACK_UID)
    return content.replace(content[begin : begin + 8], bytes(7) + b"\x01")


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep FFmpeg's remark on the codec's tag, which does no harm, off the user's terminal."""
    with _STDERR:
        kept = os.dup(2)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            os.close(nowhere)
