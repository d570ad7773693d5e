"""Figures as SVG: the same numbers give the same bytes. Text stays text, in the reader's own font."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from geoprior.report.losses import LossCurve
from geoprior.report.palette import COLOURS, FAINT_INK, GRID, INK, OWN_COLOURS, colours_of
from geoprior.report.words import count, percent
from geoprior.study.schema import ConditionResult, GroupResult

EPOCHS_LABEL = "fine-tuning epochs (one random time step of every demonstration)"
METRIC_LABELS = {"l1": "L1 error of the normalised action", "loss": "loss"}
_LAYOUT_FONT = "DejaVu Sans"
_PAGE_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Noto Sans', 'DejaVu Sans', sans-serif"
_STYLE = {
    "svg.hashsalt": "geoprior",
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": [_LAYOUT_FONT],
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT_INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.unicode_minus": True,
}


@dataclass(frozen=True)
class Size:
    """How large a figure is drawn, in CSS pixels; text sizes stay the same.

    Attributes:
        width: Of the whole figure.
        height: Of one panel.
        font: Height of the text.
        epochs_label: Name of the x axis that fits the width.
    """

    width: float
    height: float
    font: float
    epochs_label: str


WIDE = Size(860.0, 420.0, 14.0, EPOCHS_LABEL)
NARROW = Size(400.0, 340.0, 13.0, "fine-tuning epochs")


def learning_curves(group: GroupResult, size: Size = WIDE) -> bytes:
    """Success over fine-tuning epochs, one line a condition, as SVG.

    Dots are measured checkpoints, the shade is the Wilson interval of each, and a line's name stands at
    its end.

    Args:
        group: One robot and task.
        size: `WIDE` for a page, `NARROW` for a telephone.
    """
    with mpl.rc_context(_STYLE):
        figure, (axes,) = _panels(1, size)
        colours = colours_of([condition.name for condition in group.conditions])
        epochs = sorted({point.epoch for condition in group.conditions for point in condition.checkpoints})
        for condition in reversed(group.conditions):
            _draw_condition(axes, condition, colours[condition.name])
        _label_ends(axes, group.conditions, colours, size)
        axes.set_xlim(0.0, epochs[-1] * 1.02 or 1.0)
        axes.set_ylim(-2.0, 102.0)
        axes.yaxis.set_major_locator(FixedLocator([0, 20, 40, 60, 80, 100]))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: percent(value / 100.0)))
        axes.xaxis.set_major_locator(FixedLocator([0, *_ticks(epochs, 4 if size is NARROW else 8)]))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: count(round(value))))
        axes.set_xlabel(size.epochs_label, labelpad=8)
        axes.set_title("success rate", loc="left", fontsize=size.font, color=FAINT_INK, pad=10)
        return _svg(figure)


def loss_curves(curves: Sequence[LossCurve], conditions: Sequence[str], size: Size = WIDE) -> bytes:
    """Training losses on a logarithmic axis, one panel for each stage of training, as SVG.

    Args:
        curves: At least one; a name such as ``finetune/prior-s0`` goes to the panel ``finetune`` and has
            the colour of the condition ``prior``.
        conditions: Names, the baseline last, for the colours.
        size: `WIDE` or `NARROW`.
    """
    panels: dict[str, list[LossCurve]] = {}
    for curve in curves:
        panels.setdefault(curve.name.partition("/")[0], []).append(curve)
    with mpl.rc_context(_STYLE):
        figure, all_axes = _panels(len(panels), size)
        for axes, (stage, members) in zip(all_axes, panels.items(), strict=True):
            _draw_losses(axes, members, colours_of(conditions), size)
            title = f"{stage}: {METRIC_LABELS[members[0].metric]}"
            axes.set_title(title, loc="left", fontsize=size.font, color=FAINT_INK, pad=10)
        return _svg(figure)


def sight_curves(epochs: Sequence[float], lines: Mapping[str, Sequence[float]], size: Size = WIDE) -> bytes:
    """Errors over pretraining, a line each, as SVG; with one checkpoint they are dots.

    Args:
        epochs: Of the checkpoints.
        lines: By name, the error at each checkpoint; the policy's own stand before the baselines.
        size: `WIDE` or `NARROW`.
    """
    colours = (*OWN_COLOURS.values(), COLOURS[-1], COLOURS[-2])
    with mpl.rc_context(_STYLE):
        figure, (axes,) = _panels(1, size)
        for (name, values), colour in zip(lines.items(), colours, strict=True):
            style = "-" if name.endswith("images") else "--"
            axes.plot(
                epochs, values, style, color=colour, linewidth=2.2, marker="o", markersize=5, clip_on=False
            )
        top = 1.1 * max(max(values) for values in lines.values())
        heights = spread(
            [values[-1] for values in lines.values()], 1.3 * top * size.font / size.height, 0.0, top
        )
        for (name, values), colour, height in zip(lines.items(), colours, heights, strict=True):
            axes.annotate(
                f"{name} {values[-1]:.3f}",
                xy=(epochs[-1], height),
                xytext=(11, 0),
                textcoords="offset points",
                va="center",
                color=colour,
                fontsize=size.font,
                fontweight="bold",
                annotation_clip=False,
            )
        axes.set_xlim(0.0, epochs[-1] * 1.02 or 1.0)
        axes.set_ylim(0.0, top)
        axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
        axes.set_xlabel("epochs of pretraining", labelpad=8)
        title = "error of the predicted actions (normalised L1)"
        axes.set_title(title, loc="left", fontsize=size.font, color=FAINT_INK, pad=10)
        return _svg(figure)


def _panels(number: int, size: Size) -> tuple[Any, list[Any]]:
    """Panels side by side where there is room, else one below the other."""
    columns = 1 if size is NARROW else min(number, 2)
    rows = -(-number // columns)
    height = size.height if number == 1 else size.height * 0.85
    dots = 72.0
    layout = ConstrainedLayoutEngine(h_pad=8.0 / dots, w_pad=4.0 / dots)
    figure = Figure(figsize=(size.width / dots, rows * height / dots), dpi=dots, layout=layout)
    FigureCanvasSVG(figure)
    figure.patch.set_alpha(0.0)
    grid = figure.subplots(rows, columns, squeeze=False)
    every = list(grid.flat)
    for axes in every[number:]:
        axes.set_axis_off()
    for axes in every[:number]:
        axes.tick_params(labelsize=size.font, length=4, width=0.8)
        axes.xaxis.label.set_size(size.font)
        axes.grid(axis="y", color=GRID, linewidth=1.0)
        axes.set_axisbelow(True)
        axes.patch.set_alpha(0.0)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0)
    return figure, every[:number]


def _draw_condition(axes: Any, condition: ConditionResult, colour: str) -> None:
    points = condition.checkpoints
    epochs = [point.epoch for point in points]
    rates = [100.0 * point.rate for point in points]
    low = [100.0 * point.interval.low for point in points]
    high = [100.0 * point.interval.high for point in points]
    if len(points) == 1:
        axes.vlines(epochs, low, high, color=colour, alpha=0.3, linewidth=8)
    axes.fill_between(epochs, low, high, color=colour, alpha=0.14, linewidth=0)
    axes.plot(epochs, rates, color=colour, linewidth=2.4, marker="o", markersize=7, clip_on=False, zorder=3)


def _label_ends(
    axes: Any, conditions: Sequence[ConditionResult], colours: Mapping[str, str], size: Size
) -> None:
    last = [condition.last_checkpoint for condition in conditions]
    gap = 130.0 * size.font / size.height
    heights = spread([100.0 * point.rate for point in last], gap, -2.0, 102.0)
    for condition, point, height in zip(conditions, last, heights, strict=True):
        axes.annotate(
            f"{condition.name} {percent(point.rate)}",
            xy=(point.epoch, height),
            xytext=(11, 0),
            textcoords="offset points",
            va="center",
            color=colours[condition.name],
            fontsize=size.font,
            fontweight="bold",
            annotation_clip=False,
        )


def _draw_losses(axes: Any, curves: Sequence[LossCurve], colours: Mapping[str, str], size: Size) -> None:
    logs = np.log10([max(curve.values[-1], 1e-12) for curve in curves])
    for curve in curves:
        axes.plot(curve.x, curve.values, color=_loss_colour(curve.name, colours), linewidth=1.6)
    axes.set_yscale("log")
    low, high = (np.log10(bound) for bound in axes.get_ylim())
    gap = (high - low) * 1.5 * size.font / size.height
    for curve, height in zip(curves, spread(list(logs), gap, low, high), strict=True):
        axes.annotate(
            curve.name.rpartition("/")[2],
            xy=(curve.x[-1], 10.0**height),
            xytext=(7, 0),
            textcoords="offset points",
            va="center",
            color=_loss_colour(curve.name, colours),
            fontsize=size.font - 1,
            fontweight="bold",
            annotation_clip=False,
        )
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(FixedLocator(_log_ticks(10.0**low, 10.0**high)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: count(round(value))))
    axes.set_xlabel("epochs" if curves[0].x_name == "epoch" else "optimiser steps", labelpad=8)


def _loss_colour(name: str, colours: Mapping[str, str]) -> str:
    condition = name.rpartition("/")[2].rpartition("-s")[0]
    return colours.get(condition, COLOURS[-1])


def _log_ticks(low: float, high: float) -> list[float]:
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    ticks = [digit * 10.0**decade for decade in decades for digit in (1, 2, 5)]
    return [tick for tick in ticks if low <= tick <= high]


def spread(heights: Sequence[float], gap: float, low: float, high: float) -> list[float]:
    """Move labels as little as is simple so that neighbours are at least ``gap`` apart.

    Args:
        heights: Where the labels would like to stand.
        gap: Least distance.
        low: Lowest place.
        high: Highest place; with too many labels the lowest ones go below ``low``.

    Returns:
        Places in the order of ``heights``.
    """
    order = sorted(range(len(heights)), key=lambda place: (heights[place], -place))
    places = [max(height, low) for height in heights]
    for below, above in pairwise(order):
        places[above] = max(places[above], places[below] + gap)
    ceiling = high
    for place in reversed(order):
        places[place] = min(places[place], ceiling)
        ceiling = places[place] - gap
    return places


def _ticks(epochs: Sequence[int], most: int) -> list[int]:
    """Measured checkpoints, every n-th if they are many, the last one always."""
    stride = -(-len(epochs) // most)
    return list(epochs[::-1][::stride][::-1])


def _svg(figure: Any) -> bytes:
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue().replace(f"'{_LAYOUT_FONT}', sans-serif", _PAGE_FONT).encode()
