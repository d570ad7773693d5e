"""From what the cameras see to what the config's variants leave of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geoprior.errors import PluginError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from geoprior.hooks.types import Variant
    from geoprior.render.clouds import Shot


def vary(shots: Mapping[str, Shot], variants: Iterable[Variant]) -> Mapping[str, Shot]:
    """Apply variants in order.

    Args:
        shots: What each camera sees, by name.
        variants: Perhaps none; then the shots stay as they are.

    Raises:
        PluginError: A variant changed more than clouds.
    """
    for variant in variants:
        changed = variant.change(shots)
        _require_same_frames(type(variant).__name__, shots, changed)
        shots = changed
    return shots


def _require_same_frames(name: str, before: Mapping[str, Shot], after: Mapping[str, Shot]) -> None:
    """A header tells cameras and steps as they were before, and colours follow from the seed."""
    if list(after) != list(before):
        raise PluginError(
            f"variant {name}: was given the cameras {list(before)} and gave {list(after)}",
            "a variant gives every camera back, in the same order",
        )
    for camera, shot in after.items():
        was = before[camera]
        same = {
            "view": shot.view is was.view,
            "steps": shot.steps == was.steps,
            "seed": shot.seed == was.seed,
        }
        if not all(same.values()):
            changed = " and the ".join(what for what, kept in same.items() if not kept)
            raise PluginError(
                f"variant {name}: changed the {changed} of camera {camera!r}",
                "a variant changes a shot's clouds only: dataclasses.replace(shot, clouds=...)",
            )
