"""Push: a cube, and a coloured area on the table to push it to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.sim.worlds.goal import GoalWorld

from robosuite.models.objects import CylinderObject  # isort: skip - after the backend is chosen

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.tasks.push.config import PushConfig

CUBE_FRICTION = 0.4
AREA_COLOUR = (0.10, 0.55, 0.20, 1.0)
AREA_HEIGHT = 0.0005
"""Half of the disc's thickness, metres. It is there to be seen; nothing collides with it."""
CONTACT_DISTANCE = 0.05
"""Metres from the cube's centre to a closed hand behind it, about to touch it: half of the cube's diagonal,
half of the fingers, and a centimetre."""


class PushWorld(GoalWorld):
    """See `geoprior.sim.worlds.goal.GoalWorld`; the goal is a round area."""

    config: PushConfig

    def make_cube(self) -> Any:
        """The cube, as slippery as wood on wood, whatever it touches.

        robosuite's friction of 1 would have it tip rather than slide when it is pushed at half its height.
        """
        cube = super().make_cube()
        for geom in cube.get_obj().iter("geom"):
            geom.set("friction", f"{CUBE_FRICTION} 0.005 0.0001")
            geom.set("priority", "1")
        return cube

    def make_goal(self) -> Any:
        """A flat disc that is only looked at."""
        return CylinderObject(
            name="area",
            size=[self.config.radius, AREA_HEIGHT],
            rgba=AREA_COLOUR,
            joints=None,
            obj_type="visual",
        )

    def aim_points(self) -> Mapping[str, FloatArray]:
        """The cube's centre, and the point behind it from which a straight push leads to the area."""
        cube = self.cube_position()
        away = cube - self.transform_goal_to_workspace()[:3, 3]
        away[2] = 0.0
        behind = cube + CONTACT_DISTANCE * away / max(float(np.linalg.norm(away)), 1e-9)
        return {**super().aim_points(), "contact": behind}

    def succeeded(self) -> bool:
        """The cube's centre is over the area, and the cube is at rest."""
        return self.cube_over_area() and self.object_at_rest(self.cube)

    def cube_over_area(self) -> bool:
        """Whether the cube's centre is over the area, at any height: `failure` sees to that."""
        return bool(np.linalg.norm(self.cube_in_goal_frame()[:2]) < self.config.radius)

    def failure(self) -> str:
        """The cube was lifted, or fell off the table."""
        return "lifted" if self.cube_clearance() > self.config.lift else super().failure()
