"""Colours that stay apart for every kind of colour vision (after Okabe and Ito), dark enough for text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

OWN_COLOURS = {"prior": "#0067a5", "scratch": "#b34700"}
COLOURS = ("#00795a", "#9b4f84", "#7a6a00", "#4a4e69")
INK = "#1c2430"
FAINT_INK = "#5a6473"
GRID = "#dde2e8"


def colours_of(conditions: Sequence[str]) -> Mapping[str, str]:
    """A colour for each condition; ``prior`` and ``scratch`` have the same ones on every page.

    With more conditions than colours they repeat: lines carry their names, so that nothing hangs on it.
    """
    others = [name for name in conditions if name not in OWN_COLOURS]
    cycle = {name: COLOURS[place % len(COLOURS)] for place, name in enumerate(others)}
    return {name: OWN_COLOURS.get(name) or cycle[name] for name in conditions}
