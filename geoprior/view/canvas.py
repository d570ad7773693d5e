"""Parts of a picture: frames made RGB and large enough to see, captions, and their arrangement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

if TYPE_CHECKING:
    from numpy.typing import NDArray

GAP = 4
BACKGROUND = 34  # grey: one number fills a canvas ten times as fast as three
INK = (225, 228, 235)
FAINT = (150, 156, 168)
_FONT_SIZE = 12
_LINE_HEIGHT = 18


def to_rgb(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A (H, W) binary or gray, or (H, W, 3) RGB frame as (H, W, 3) RGB."""
    return np.repeat(frame[..., None], 3, axis=2) if frame.ndim == 2 else frame


def fit(frame: NDArray[np.uint8], height: int) -> NDArray[np.uint8]:
    """Bring an RGB frame near a height: whole pixels when it grows, area averages when it shrinks.

    Args:
        frame: (H, W, 3) uint8.
        height: Rows wanted; a frame that is smaller becomes a whole multiple of itself, the largest that
            fits.
    """
    rows, columns = frame.shape[:2]
    if rows <= height:
        return enlarge(frame, height // rows)
    size = (max(1, round(columns * height / rows)), height)
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), np.uint8)


def enlarge(frame: NDArray[np.uint8], scale: int) -> NDArray[np.uint8]:
    """Repeat each pixel ``scale`` times along rows and columns."""
    return frame if scale == 1 else frame.repeat(scale, axis=0).repeat(scale, axis=1)


def caption(lines: Sequence[str], width: int, colour: tuple[int, int, int] = INK) -> NDArray[np.uint8]:
    """A bar of left-aligned lines of text, each cut to fit ``width`` pixels; (H, width, 3) uint8."""
    image = Image.new("RGB", (width, len(lines) * _LINE_HEIGHT), (BACKGROUND,) * 3)
    draw = ImageDraw.Draw(image)
    for number, line in enumerate(lines):
        draw.text((2, number * _LINE_HEIGHT + 2), _cut(line, width - 4), fill=colour, font=_font())
    return np.asarray(image, np.uint8)


def legend(entries: Mapping[str, tuple[int, int, int]], width: int) -> NDArray[np.uint8]:
    """A bar of words, each after a dot of its colour, in as many lines as they need; (H, width, 3) uint8."""
    places: list[tuple[int, int]] = []
    left, line = 2, 0
    for word in entries:
        needed = _LINE_HEIGHT + int(_font().getlength(word))
        if left > 2 and left + needed > width:
            left, line = 2, line + 1
        places.append((left, line * _LINE_HEIGHT))
        left += needed + _LINE_HEIGHT // 2
    bar = blank((line + 1) * _LINE_HEIGHT, width)
    for (left, top), colour in zip(places, entries.values(), strict=True):
        middle = (16 * (left + 6), 16 * (top + _LINE_HEIGHT // 2))
        cv2.circle(bar, middle, 16 * 4, colour, cv2.FILLED, cv2.LINE_AA, 4)
    image = Image.fromarray(bar)
    draw = ImageDraw.Draw(image)
    for (left, top), word in zip(places, entries, strict=True):
        draw.text((left + _LINE_HEIGHT - 4, top + 2), word, fill=FAINT, font=_font())
    return np.asarray(image, np.uint8)


@lru_cache(maxsize=64)
def text_mask(text: str) -> NDArray[np.float64]:
    """(H, W) share of each pixel that a line of text covers, 0 to 1, to be laid over a picture."""
    width = max(1, round(_font().getlength(text)) + 2)
    image = Image.new("L", (width, _LINE_HEIGHT))
    ImageDraw.Draw(image).text((1, 2), text, fill=255, font=_font())
    mask = np.asarray(image, np.float64) / 255.0
    mask.setflags(write=False)
    return mask


def beside(parts: Sequence[NDArray[np.uint8]], gap: int = GAP) -> NDArray[np.uint8]:
    """RGB parts from left to right, aligned at the top."""
    height = max(part.shape[0] for part in parts)
    width = sum(part.shape[1] for part in parts) + gap * (len(parts) - 1)
    canvas = blank(height, width)
    left = 0
    for part in parts:
        canvas[: part.shape[0], left : left + part.shape[1]] = part
        left += part.shape[1] + gap
    return canvas


def below(parts: Sequence[NDArray[np.uint8]], gap: int = GAP) -> NDArray[np.uint8]:
    """RGB parts from top to bottom, aligned at the left."""
    width = max(part.shape[1] for part in parts)
    height = sum(part.shape[0] for part in parts) + gap * (len(parts) - 1)
    canvas = blank(height, width)
    top = 0
    for part in parts:
        canvas[top : top + part.shape[0], : part.shape[1]] = part
        top += part.shape[0] + gap
    return canvas


def framed(part: NDArray[np.uint8], margin: int = 2 * GAP) -> NDArray[np.uint8]:
    """A part with a margin on every side."""
    canvas = blank(part.shape[0] + 2 * margin, part.shape[1] + 2 * margin)
    canvas[margin:-margin, margin:-margin] = part
    return canvas


def blank(height: int, width: int) -> NDArray[np.uint8]:
    """(height, width, 3) uint8 of the background's colour."""
    return np.full((height, width, 3), BACKGROUND, np.uint8)


def _cut(line: str, width: int) -> str:
    if _font().getlength(line) <= width:
        return line
    while line and _font().getlength(line + "…") > width:
        line = line[:-1]
    return line + "…"


@lru_cache(maxsize=1)
def _font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(_FONT_SIZE)
