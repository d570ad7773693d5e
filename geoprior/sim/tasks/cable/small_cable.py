"""A cable of short capsules on ball joints, with a plug at one end to take hold of."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.sim.backend import prepare_robosuite

prepare_robosuite()

from robosuite.models.objects import BoxObject, CapsuleObject, CompositeBodyObject  # noqa: E402

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray

SEGMENTS = 14
SEGMENT_LENGTH = 0.02
RADIUS = 0.005
"""Metres; the length is from joint to joint."""

PLUG_HALF_SIZE = np.array([0.018, 0.013, 0.014])
"""Metres along the cable, across it, and upward."""

DENSITY = 1000.0
"""Kilogrammes a cubic metre: a cable of 29 g, a plug of 26 g."""

STIFFNESS = 2e-4
DAMPING = 5e-4
ARMATURE = 5e-6
"""Of a joint: newton metres a radian, newton metres a radian a second, kilogramme square metres. The table's
friction holds a bend against so soft a spring. Without damping and armature (many times a segment's own
inertia) a thrown cable breaks the simulation at its step of 2 ms; with twice the damping, an arch of cable
that is let go sinks too slowly."""

LARGEST_BEND = 0.8
"""Radians at one joint. A segment does not collide with its neighbours: without this limit the first could
fold into the plug, which then lies on the cable and rolls off it."""

CABLE_COLOUR = (0.10, 0.12, 0.15, 1.0)
PLUG_COLOUR = (0.90, 0.45, 0.05, 1.0)

_OUTLET = np.array([-PLUG_HALF_SIZE[0], 0.0, RADIUS - PLUG_HALF_SIZE[2]])
"""Where the cable leaves the plug, so that both lie on the table."""


class SmallCable(CompositeBodyObject):  # type: ignore[misc]  # robosuite has no types
    """A plug with a free joint, and a chain of capsules behind it.

    The object's frame is the plug's: origin in its middle, z up, x along the cable and out of it.

    Args:
        name: Of the object.
    """

    def __init__(self, name: str) -> None:
        segments = [_segment(number) for number in range(SEGMENTS)]
        bodies = [segment.root_body for segment in segments]
        first, next_one = _OUTLET - [SEGMENT_LENGTH / 2.0, 0.0, 0.0], np.array([0.0, 0.0, SEGMENT_LENGTH])
        # A capsule's own axis is its z: the first one's is turned to the plug's -x, its x to the plug's z.
        to_plug = [np.sqrt(0.5), 0.0, -np.sqrt(0.5), 0.0]
        super().__init__(
            name=name,
            objects=[_plug(), *segments],
            object_locations=[np.zeros(3), first, *[next_one] * (SEGMENTS - 1)],
            object_quats=[None, to_plug, *[None] * (SEGMENTS - 1)],
            object_parents=["root", "root", *bodies[:-1]],
            body_joints={body: [_ball(number)] for number, body in enumerate(bodies)},
        )

    @property
    def ball_joints(self) -> list[str]:
        """Names of the joints, the plug's first; each turns about the vertical by a turn about its own x."""
        return [f"{self.naming_prefix}ball{number}" for number in range(SEGMENTS)]

    @property
    def segments(self) -> list[str]:
        """Names of the bodies of the cable, the plug's first; the origin of each is in its middle."""
        return [f"{self.naming_prefix}segment{number}_main" for number in range(SEGMENTS)]


def outline(position: FloatArray, yaw: float, bends: FloatArray) -> FloatArray:
    """(`SEGMENTS` + 1, 2) the cable's joints and its far end, seen from above, workspace frame, metres.

    Args:
        position: (2,) of the plug's middle.
        yaw: Radians about the vertical, of the plug's x axis.
        bends: (`SEGMENTS`,) radians about the vertical at each joint, the plug's first.
    """
    headings = yaw + np.pi + np.cumsum(bends)
    steps = SEGMENT_LENGTH * np.column_stack([np.cos(headings), np.sin(headings)])
    outlet = position + _OUTLET[0] * np.array([np.cos(yaw), np.sin(yaw)])
    joints: FloatArray = outlet + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    return joints


def _plug() -> Any:
    return BoxObject(name="plug", size=PLUG_HALF_SIZE, density=DENSITY, rgba=PLUG_COLOUR)


def _segment(number: int) -> Any:
    size = [RADIUS, SEGMENT_LENGTH / 2.0]
    return CapsuleObject(name=f"segment{number}", size=size, density=DENSITY, rgba=CABLE_COLOUR)


def _ball(number: int) -> dict[str, str]:
    return {
        "name": f"ball{number}",
        "type": "ball",
        "pos": f"0 0 {-SEGMENT_LENGTH / 2.0}",
        "stiffness": str(STIFFNESS),
        "damping": str(DAMPING),
        "armature": str(ARMATURE),
        "limited": "true",
        "range": f"0 {LARGEST_BEND}",
    }
