"""robosuite's door, made small enough for a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from geoprior.sim.backend import prepare_robosuite

prepare_robosuite()

from robosuite.models.objects import DoorObject  # noqa: E402

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

    from geoprior.geometry.se3 import FloatArray

PANEL_SIZE = np.array([0.19, 0.016, 0.24])
PANEL_GAP = 0.008
"""Metres between the table and the panel."""

POST_RADIUS = 0.011
POST_HEIGHT = 0.252
POST_OFFSET = 0.109
"""Metres from the panel's middle to the middle of either post; the hinge's axis is the middle of one."""

HANDLE_SIZE = np.array([0.042, 0.013, 0.016])
HANDLE_POSITION = np.array([-0.059, -0.066, 0.100])
"""Middle of the handle's bar in the closed door's frame, metres: the bar stands clear of the panel by what an
open finger needs."""

STEM_RADIUS = 0.007

HINGE_RANGE = 1.0
HINGE_DAMPING = 0.1
HINGE_FRICTION = 0.05
"""Radians; newton metres a radian a second, as in robosuite's own task; newton metres."""

PANEL_MASS = 0.30
HANDLE_MASS = 0.05
PANEL_COLOUR = (0.36, 0.22, 0.12, 1.0)
POST_COLOUR = (0.80, 0.80, 0.78, 1.0)
HANDLE_COLOUR = (0.93, 0.70, 0.12, 1.0)


class SmallDoor(DoorObject):  # type: ignore[misc]  # robosuite has no types
    """robosuite's `DoorObject` without a latch: two posts, a panel on a hinge, a handle to pull.

    The original is 0.6 m high, as high as the third camera stands. robosuite's scaling would leave its
    inertia and its handle's stem as they are, so every measure is set here.

    The door's frame: origin on the table under the panel's middle, z up, x along the closed panel towards
    the hinge, y from the handle's side to the back. A positive angle opens it to the handle's side.

    Args:
        name: Of the object.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name=name, friction=HINGE_FRICTION, damping=HINGE_DAMPING, lock=False)
        middle = PANEL_GAP + PANEL_SIZE[2] / 2.0
        at_handle = HANDLE_POSITION - [0.0, 0.0, middle]
        self._set("body", "frame", {"pos": [0.0, 0.0, 0.0], "quat": [1.0, 0.0, 0.0, 0.0]})
        for post, side in (("r_frame", 1.0), ("l_frame", -1.0)):
            where = [side * POST_OFFSET, 0.0, POST_HEIGHT / 2.0]
            self._shape(post, [POST_RADIUS, POST_HEIGHT / 2.0], where, POST_COLOUR)
        self._set("body", "door", {"pos": [0.0, 0.0, middle]})
        self._set("joint", "hinge", {"pos": [POST_OFFSET, 0.0, 0.0], "range": [0.0, HINGE_RANGE]})
        self._shape("panel", PANEL_SIZE / 2.0, [0.0, 0.0, 0.0], PANEL_COLOUR)
        self._set("body", "latch", {"pos": at_handle})
        self._shape("handle", HANDLE_SIZE / 2.0, [0.0, 0.0, 0.0], HANDLE_COLOUR)
        end = -HANDLE_SIZE[0] / 2.0 + STEM_RADIUS
        self._shape("handle_base", [STEM_RADIUS], None, HANDLE_COLOUR)
        self._set("geom", "handle_base", {"fromto": [end, 0.0, 0.0, end, -at_handle[1], 0.0]})
        self._set("site", "handle", {"pos": [0.0, 0.0, 0.0]})
        self._weigh("door", PANEL_MASS, PANEL_SIZE)
        self._weigh("latch", HANDLE_MASS, HANDLE_SIZE)
        # Its place is then part of the simulation's state and not of the model.
        self._obj.set("mocap", "true")

    def _shape(
        self,
        name: str,
        size: FloatArray | list[float],
        position: FloatArray | list[float] | None,
        colour: tuple[float, ...],
    ) -> None:
        self._element("geom", name).attrib.pop("material", None)
        numbers: dict[str, FloatArray | list[float]] = {"size": size, "rgba": list(colour)}
        if position is not None:
            numbers["pos"] = position
        self._set("geom", name, numbers)

    def _weigh(self, name: str, mass: float, size: FloatArray) -> None:
        """Give a body the inertia of a box in its origin."""
        inertial = self._element("body", name).find("inertial")
        squares = size**2
        moments = mass / 12.0 * (squares.sum() - squares)
        numbers = {"pos": [0.0] * 3, "quat": [1.0, 0.0, 0.0, 0.0], "mass": [mass], "diaginertia": moments}
        _write(inertial, numbers)

    def _set(self, tag: str, name: str, numbers: Mapping[str, FloatArray | list[float]]) -> None:
        _write(self._element(tag, name), numbers)

    def _element(self, tag: str, name: str) -> ET.Element:
        return next(each for each in self._obj.iter(tag) if each.get("name") == self.naming_prefix + name)


def _write(element: ET.Element | None, numbers: Mapping[str, FloatArray | list[float]]) -> None:
    assert element is not None
    for key, value in numbers.items():
        element.set(key, " ".join(repr(float(number)) for number in value))
