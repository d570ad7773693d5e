"""The scripted closing: with closed fingers before the open door, then along an arc until it is shut."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.sim.experts.course import Course
from geoprior.sim.experts.path import AT_ONCE, Waypoint, eased, hand_down
from geoprior.sim.tasks.door.small_door import PANEL_SIZE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.tasks.close.world import CloseWorld

CLOSED = 1.0


@dataclass(frozen=True)
class Arc:
    """Where the hand touches the panel, for every angle of the door.

    Attributes:
        hinge: (3,) a point of the hinge's axis in the workspace frame, metres.
        facing: Radians about +z from the workspace's +x to where the handle's side of the shut door looks.
        contact: (3,) of the hand frame when the door is shut, metres: from the hinge along the panel, from
            the panel's middle plane towards the hand, and over the table.
        slant: Radians between the hand's forward axis and the vertical; it points at the panel and down.
    """

    hinge: FloatArray
    facing: float
    contact: FloatArray
    slant: float

    def at(self, angle: float, speed: float) -> Waypoint:
        """The hand at a door that is open by ``angle`` radians."""
        turn = Rotation.from_euler("z", self.facing + angle - np.pi / 2.0)
        rotation = turn * Rotation.from_euler("x", -self.slant) * hand_down(0.0)
        position = turn.apply(self.contact) + np.array([*self.hinge[:2], 0.0])
        return Waypoint(position, rotation, CLOSED, speed)


def close_expert(
    world: CloseWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """One demonstration; see `geoprior.sim.tasks.task.Task.expert`.

    What varies: speed, slant, where on the panel the fingers push, from how far they come, how fast and how
    far they push, and the pauses.
    """
    course, arc, angle = Course(world, start), _draw_arc(world, rng), world.hinge_angle()
    before, end = angle + rng.uniform(0.20, 0.32), -rng.uniform(0.04, 0.07)
    yield from course.go(arc.at(before, rng.uniform(0.11, 0.16)))
    yield from course.rest(patience=int(rng.integers(3, 8)))
    steps = round((before - end) / rng.uniform(0.25, 0.38) * world.control_freq)
    angles = [before + (end - before) * eased(step / steps) for step in range(1, steps + 1)]
    yield from course.go(*(arc.at(each, AT_ONCE) for each in angles))
    yield from course.rest(patience=int(rng.integers(5, 9)))
    yield from course.go(arc.at(end, AT_ONCE))


def _draw_arc(world: CloseWorld, rng: np.random.Generator) -> Arc:
    """Over the handle, and well away from the hinge."""
    towards_panel = world.transform_handle_to_workspace()[:3, 1]
    facing = float(np.arctan2(-towards_panel[1], -towards_panel[0])) - world.hinge_angle()
    right, _, reach = world.robot.closed_fingers
    slant = rng.uniform(np.radians(20.0), np.radians(35.0))
    finger = 0.5 * right * np.cos(slant) + reach * np.sin(slant)
    contact = [rng.uniform(0.12, 0.18), PANEL_SIZE[1] / 2.0 + finger, rng.uniform(0.15, 0.19)]
    return Arc(world.hinge_position(), facing, np.array(contact), slant)
