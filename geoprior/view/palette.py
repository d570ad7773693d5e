"""Colours on the pictures' dark ground, after Okabe and Ito: apart for every kind of colour vision."""

from __future__ import annotations

from geoprior.view.canvas import INK

Colour = tuple[int, int, int]

FLOOR: Colour = (138, 144, 156)
OBJECT: Colour = (86, 180, 233)
MARKER: Colour = (20, 190, 140)
HAND: Colour = (240, 165, 40)
CAMERA: Colour = (178, 184, 198)
BODIES: dict[str, Colour] = {"floor": FLOOR, "object": OBJECT, "marker": MARKER, "hand": HAND}
"""RGB of a cloud's points, by body."""

AXES: dict[str, Colour] = {"right": (214, 120, 180), "up": (240, 228, 66), "forward": (250, 250, 250)}
"""RGB of the hand frame's axes, in the order of its columns."""


def colour_of(body: str) -> Colour:
    """A body's colour; what a plug-in adds is drawn in the colour of the captions."""
    return BODIES.get(body, INK)
