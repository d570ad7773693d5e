"""Place: a cube, and a low-walled square enclosure to put it into."""

from __future__ import annotations

from typing import Any

import numpy as np

from geoprior.sim.worlds.cube import CUBE_HALF_SIZE
from geoprior.sim.worlds.goal import GoalWorld

from robosuite.models.objects import CompositeObject  # isort: skip - after the backend is chosen

INNER_HALF_SIZE = 0.05
WALL_THICKNESS = 0.006
WALL_HEIGHT = 0.016
ENCLOSURE_COLOUR = (0.10, 0.25, 0.70, 1.0)
"""Four walls without a floor; a cube that lies on the table within them has 29 mm to spare on each side."""

FLAT = 0.003
"""Metres: a cube whose centre is higher than on the table by more than this leans on a wall or lies on it."""


class PlaceWorld(GoalWorld):
    """See `geoprior.sim.worlds.goal.GoalWorld`; the goal is an enclosure."""

    def make_goal(self) -> Any:
        """Four walls around a square."""
        middle, half = INNER_HALF_SIZE + WALL_THICKNESS / 2.0, INNER_HALF_SIZE + WALL_THICKNESS
        sides = [np.array(side) for side in ((1, 0), (0, 1), (-1, 0), (0, -1))]
        return CompositeObject(
            name="enclosure",
            total_size=[half, half, WALL_HEIGHT],
            geom_types=["box"] * 4,
            geom_locations=[[*(middle * side), WALL_HEIGHT / 2.0] for side in sides],
            geom_sizes=[[*np.where(side, WALL_THICKNESS / 2.0, half), WALL_HEIGHT / 2.0] for side in sides],
            rgba=ENCLOSURE_COLOUR,
            locations_relative_to_center=True,
            joints=None,
        )

    def succeeded(self) -> bool:
        """The cube lies flat on the table within the walls, at rest, and the gripper does not touch it."""
        return self.cube_inside() and self.object_at_rest(self.cube) and not self.object_in_hand(self.cube)

    def cube_inside(self) -> bool:
        """Whether the cube lies flat on the table within the walls.

        Its centre is then at least half an edge from every wall; judged with a millimetre's grace.
        """
        x, y, z = self.cube_in_goal_frame()
        room = INNER_HALF_SIZE - CUBE_HALF_SIZE + 0.001
        return bool(max(abs(x), abs(y)) < room and abs(z - CUBE_HALF_SIZE) < FLAT)
