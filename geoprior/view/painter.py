"""Paint marks as a camera sees them: the farthest first, so that what is nearer lies over it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from geoprior.geometry.projection import NEAREST, View, project
from geoprior.geometry.se3 import invert
from geoprior.view.canvas import BACKGROUND, blank, text_mask
from geoprior.view.marks import Dots, Label, Lines, Mark
from geoprior.view.outline import Outline

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

_GROUND = float(BACKGROUND)
_FINE = 2
_SHIFT = 4  # OpenCV takes fractions of pixels in sixteenths
_ROWS = 600  # a frame of so many rows has lines and dots of their nominal size
_FAINTEST = 0.45  # what is left of the colour of a group's farthest dot
_RADII = np.array([1.3, 5.0])  # pixels: smaller discs would flicker, larger ones hide the shape
_FARTHEST = 20  # frames away: what is projected there cannot be seen
_BESIDE = 5  # pixels between a point and its label


@dataclass(frozen=True)
class Strokes:
    """Discs and lines in the frame.

    Attributes:
        ends: (S, 4) column and row of both ends, pixels; a disc has its centre twice.
        depths: (S,) metres.
        sizes: (S,) radii of discs in pixels, or minus the widths of lines.
        colours: (S, 3) RGB, 0 to 255.
    """

    ends: FloatArray
    depths: FloatArray
    sizes: FloatArray
    colours: FloatArray


def paint(marks: Iterable[Mark | Outline], view: View) -> NDArray[np.uint8]:
    """Paint a picture.

    Args:
        marks: In any order. Dots and lines are laid over each other by depth, a line by that of its middle;
            dots of one group fade from its nearest to its farthest, for a shape made of points alone would
            look flat. Labels come last.
        view: A fixed camera. What is nearer than `NEAREST` is left out.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    marks = list(marks)
    dots = [mark for mark in marks if isinstance(mark, Dots) and len(mark.points)]
    eye = invert(view.transforms_world_to_camera)[:3, 3]
    outlines = [line for mark in marks if isinstance(mark, Outline) for line in mark.lines(eye)]
    lines = [mark for mark in [*marks, *outlines] if isinstance(mark, Lines) and len(mark.segments)]
    strokes = [_discs(dots, view)] if dots else []
    strokes += [_pieces(lines, view)] if lines else []
    canvas = _drawn(strokes, view)
    for mark in marks:
        if isinstance(mark, Label):
            _write(canvas, mark, view)
    return canvas


def _discs(groups: Sequence[Dots], view: View) -> Strokes:
    points = np.concatenate([dots.points for dots in groups])
    counts = np.array([len(dots.points) for dots in groups])
    pixels, depths = project(points, view.transforms_world_to_camera, view.intrinsics)
    radii = np.repeat([dots.radius for dots in groups], counts)
    colours = np.array([_faded(dots.colour, dots.strength) for dots in groups])
    with np.errstate(divide="ignore"):
        sizes = np.clip(radii * view.intrinsics[0, 0] / depths, *_RADII * max(_scale(view), 0.6))
    fades = 1.0 - (1.0 - _FAINTEST) * _farness(depths, counts)
    faded = _GROUND + fades[:, None] * (np.repeat(colours, counts, axis=0) - _GROUND)
    seen = _can_be_drawn(pixels, depths, view)
    return Strokes(np.hstack([pixels, pixels])[seen], depths[seen], sizes[seen], faded[seen])


def _pieces(groups: Sequence[Lines], view: View) -> Strokes:
    points = np.concatenate([lines.segments for lines in groups]).reshape(-1, 3)
    counts = [len(lines.segments) for lines in groups]
    pixels, depths = project(points, view.transforms_world_to_camera, view.intrinsics)
    widths = np.array([max(1.0, lines.width * _scale(view)) for lines in groups])
    colours = np.array([_faded(lines.colour, lines.strength) for lines in groups])
    seen = _can_be_drawn(pixels, depths, view).reshape(-1, 2).all(axis=1)
    return Strokes(
        ends=pixels.reshape(-1, 4)[seen],
        depths=depths.reshape(-1, 2).mean(axis=1)[seen],
        sizes=np.repeat(-widths, counts)[seen],
        colours=np.repeat(colours, counts, axis=0)[seen],
    )


def _farness(depths: FloatArray, counts: NDArray[np.int64]) -> FloatArray:
    """(P,) from 0 for the nearest of each group of so many neighbours to 1 for its farthest."""
    starts = np.cumsum(counts) - counts
    nearest, farthest = np.minimum.reduceat(depths, starts), np.maximum.reduceat(depths, starts)
    span = np.where(farthest > nearest, farthest - nearest, 1.0)
    return np.asarray((depths - np.repeat(nearest, counts)) / np.repeat(span, counts))


def _can_be_drawn(pixels: FloatArray, depths: FloatArray, view: View) -> NDArray[np.bool_]:
    """Which points are before the camera, and not so far away that OpenCV could not count the pixels."""
    near_frame = (np.abs(pixels) < _FARTHEST * max(view.height, view.width)).all(axis=1)
    return np.asarray((depths > NEAREST) & near_frame)


def _faded(colour: Sequence[int], strength: float) -> FloatArray:
    return np.asarray(_GROUND + strength * (np.array(colour, np.float64) - _GROUND))


def _drawn(strokes: Sequence[Strokes], view: View) -> NDArray[np.uint8]:
    """The picture: drawn finer than it is and brought down by area, which smooths discs of a pixel or two."""
    fine = blank(view.height * _FINE, view.width * _FINE)
    if strokes:
        order = np.argsort(-np.concatenate([each.depths for each in strokes]), kind="stable")
        ends = np.concatenate([each.ends for each in strokes])[order]
        sizes = float(_FINE) * np.concatenate([each.sizes for each in strokes])[order]
        colours = np.concatenate([each.colours for each in strokes])[order]
        _draw(fine, (ends + 0.5) * _FINE - 0.5, sizes, colours)
    return np.asarray(cv2.resize(fine, (view.width, view.height), interpolation=cv2.INTER_AREA), np.uint8)


def _draw(canvas: NDArray[np.uint8], ends: FloatArray, sizes: FloatArray, colours: FloatArray) -> None:
    fixed = np.round(ends * (1 << _SHIFT)).astype(int)
    firsts, lasts = fixed[:, :2].tolist(), fixed[:, 2:].tolist()
    radii = np.round(sizes * (1 << _SHIFT)).astype(int).tolist()
    widths = np.maximum(1, -sizes).round().astype(int).tolist()
    inks = colours.round().astype(int).tolist()
    for first, last, radius, width, ink in zip(firsts, lasts, radii, widths, inks, strict=True):
        if radius > 0:
            cv2.circle(canvas, first, radius, ink, cv2.FILLED, cv2.LINE_8, _SHIFT)
        else:
            cv2.line(canvas, first, last, ink, width, cv2.LINE_8, _SHIFT)


def _write(canvas: NDArray[np.uint8], label: Label, view: View) -> None:
    pixels, depths = project(label.point[None], view.transforms_world_to_camera, view.intrinsics)
    column, row = pixels[0]
    if depths[0] <= NEAREST or not (0 <= column < view.width and 0 <= row < view.height):
        return
    mask = text_mask(label.text)[..., None]
    height, width = min(mask.shape[0], view.height), min(mask.shape[1], view.width)
    left = int(np.clip(column + _BESIDE, 0, view.width - width))
    top = int(np.clip(row - _BESIDE - height, 0, view.height - height))
    patch = canvas[top : top + height, left : left + width]
    ink = mask[:height, :width]
    patch[:] = (patch * (1.0 - ink) + np.array(label.colour) * ink).round()


def _scale(view: View) -> float:
    return view.height / _ROWS
