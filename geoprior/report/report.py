"""Write ``report/index.html`` from results, media and logs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from geoprior.errors import DataError
from geoprior.files import write_bytes
from geoprior.report.figures import NARROW, WIDE, learning_curves, loss_curves, sight_curves
from geoprior.report.html import PageMedia, Picture, SightSection, group_section, render
from geoprior.report.losses import LossCurve, read_log
from geoprior.report.sight import read_sight
from geoprior.report.words import percent
from geoprior.study.schema import GroupResult, Results, parse_results

PAGE = "index.html"
MEDIA = "media"
PRETRAINING = "pretrain"
"""Name of the training whose log tells of the prior's sight."""
SECTIONS = ("synthetic", "demonstrations", "rollouts")


@dataclass(frozen=True)
class Media:
    """An image or a film for the report.

    Attributes:
        section: Where it belongs.
        path: The file; it is copied.
        caption: One sentence, also the alternative text.
        kind: ``image`` (PNG, JPEG, SVG) or ``film`` (WebM).
        condition: The condition that a rollout shows; films of one condition stand together.
    """

    section: Literal["synthetic", "demonstrations", "rollouts"]
    path: Path
    caption: str
    kind: Literal["image", "film"]
    condition: str = ""


def write_report(
    *,
    out: Path,
    results: Mapping[str, Any],
    config_text: str,
    run: Mapping[str, Any],
    media: Sequence[Media] = (),
    losses: Mapping[str, Path] | None = None,
) -> Path:
    """Write the page and everything that it shows; what an earlier report left in ``media/`` goes.

    Args:
        out: The report's own folder.
        results: The content of ``results.json``.
        config_text: The resolved config, as YAML.
        run: The content of ``run.json``: versions, machine, stages with their seconds; parts may be missing.
        media: In the order in which they are shown.
        losses: By name of the training (``pretrain``, ``finetune/prior-s0``), its ``log.jsonl``.

    Returns:
        The path of the page. It opens from the disk: no server, no net.

    Raises:
        DataError: ``results`` is foreign, or a file to show cannot be read, or ``out`` cannot be written.
    """
    parsed = parse_results(results)
    folder = _Folder(out)
    pictures = [_curve_picture(group, parsed, folder) for group in parsed.groups]
    shown = {
        section: [folder.add_media(one) for one in media if one.section == section] for section in SECTIONS
    }
    page = render(
        parsed,
        [
            group_section(group, picture, parsed.confidence)
            for group, picture in zip(parsed.groups, pictures, strict=True)
        ],
        media=shown,
        losses=_loss_picture(losses or {}, parsed, folder),
        sight=_sight_section(losses or {}, folder),
        config_text=config_text,
        run=run,
    )
    write_bytes(out / PAGE, page.encode())
    folder.remove_others()
    return out / PAGE


class _Folder:
    """The report's media folder: names are made safe and are given once."""

    def __init__(self, out: Path) -> None:
        self.path = out / MEDIA
        self.names: set[str] = set()

    def add(self, name: str, content: bytes) -> str:
        """Write a file and return its path from the page."""
        stem, dot, suffix = re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.").rpartition(".")
        free = next(
            candidate
            for number in range(1, len(self.names) + 2)
            if (candidate := f"{stem}{'' if number == 1 else f'-{number}'}{dot}{suffix}") not in self.names
        )
        write_bytes(self.path / free, content)
        self.names.add(free)
        return f"{MEDIA}/{free}"

    def add_media(self, media: Media) -> PageMedia:
        """Copy an image or a film."""
        try:
            content = media.path.read_bytes()
        except OSError as error:
            raise DataError(
                f"{media.path}: cannot be read for the report ({error.strerror or error})",
                "run the stage that makes it again",
            ) from error
        parts = [part for part in (media.section, media.condition, media.path.name) if part]
        return PageMedia(self.add("-".join(parts), content), media.caption, media.kind, media.condition)

    def remove_others(self) -> None:
        """Remove what this report does not show."""
        for path in self.path.iterdir():
            if path.is_file() and path.name not in self.names:
                path.unlink()


def _curve_picture(group: GroupResult, results: Results, folder: _Folder) -> Picture:
    name = f"learning-curve-{group.robot}-{group.task}-{group.look}"
    ends = ", ".join(
        f"{condition.name} from {percent(condition.checkpoints[0].rate)} to "
        f"{percent(condition.last_checkpoint.rate)}"
        for condition in group.conditions
    )
    trials = sorted({point.trials for condition in group.conditions for point in condition.checkpoints})
    each = str(trials[0]) if len(trials) == 1 else f"{trials[0]} to {trials[-1]}"
    return Picture(
        wide=folder.add(f"{name}.svg", learning_curves(group, WIDE)),
        narrow=folder.add(f"{name}-narrow.svg", learning_curves(group, NARROW)),
        alt=f"Success rate against fine-tuning epochs: {ends}.",
        caption=(
            f"Dots: measured checkpoints, {each} rollouts each. Shade: {percent(results.confidence)} Wilson "
            "interval of each rate. All conditions meet the same initial states: read their difference from "
            "the paired intervals, not from how the shades overlap."
        ),
    )


def _loss_picture(losses: Mapping[str, Path], results: Results, folder: _Folder) -> Picture | None:
    curves = [curve for name, path in losses.items() if (curve := read_log(name, path)) is not None]
    if not curves:
        return None
    names = [condition.name for condition in results.groups[0].conditions]
    ends = ", ".join(f"{curve.name} ends at {curve.values[-1]:.3g}" for curve in curves)
    return Picture(
        wide=folder.add("training-losses.svg", loss_curves(curves, names, WIDE)),
        narrow=folder.add("training-losses-narrow.svg", loss_curves(curves, names, NARROW)),
        alt=f"Training losses: {ends}.",
        caption=(
            "Means over stretches of training, on a logarithmic axis. A lower loss does not rank "
            f"policies: success goes on rising after the loss is flat.{_damage(curves)}"
        ),
    )


def _sight_section(losses: Mapping[str, Path], folder: _Folder) -> SightSection | None:
    curve = read_sight(losses[PRETRAINING]) if PRETRAINING in losses else None
    if curve is None:
        return None
    ends = ", ".join(f"{name} {values[-1]:.3f}" for name, values in curve.lines.items())
    picture = Picture(
        wide=folder.add("sight.svg", sight_curves(curve.epochs, curve.lines, WIDE)),
        narrow=folder.add("sight-narrow.svg", sight_curves(curve.epochs, curve.lines, NARROW)),
        alt=f"Errors of the prior on episodes that it never saw: {ends}.",
        caption=(
            "On synthetic episodes that no training saw, lower is better. The wider the gap between true "
            "images and another episode's, the more the prior looks; dashed: what can be had without looking."
        ),
    )
    return SightSection(curve.sentence, curve.caution, picture, list(curve.last.items()))


def _damage(curves: Sequence[LossCurve]) -> str:
    damaged = sum(curve.damaged for curve in curves)
    return f" Damaged lines of the logs left out: {damaged}." if damaged else ""
