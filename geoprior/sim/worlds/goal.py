"""A cube and a goal that an episode sets up elsewhere on the table: what place and push share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geoprior.geometry.se3 import apply, invert
from geoprior.sim.worlds.cube import CubeWorld, turn_about_z
from geoprior.sim.worlds.placing import draw_two_places
from geoprior.sim.worlds.tabletop import TABLE_TOP

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.tasks.timed import GoalOptions

MIDDLE = np.array([-0.05, 0.0])
"""Middle of the rectangle in the workspace frame, metres: nearer to the arms than the table's, where all of
them still reach behind a cube and the third camera's view is wide enough for all of a goal."""


class GoalWorld(CubeWorld):
    """A cube, and a goal that stays where an episode sets it up.

    The goal is a MuJoCo mocap body: it collides, if it has what collides, and nothing moves it; its place is
    part of the simulation's state and not of the model.

    Args:
        robot: The arm.
        setting: How it is seen and paced.
        config: Where cube and goal may lie.
    """

    def __init__(self, robot: Robot, setting: Setting, config: GoalOptions) -> None:
        self.config = config
        super().__init__(robot, setting)

    def make_goal(self) -> Any:
        """The robosuite object, without joints; its origin comes to lie on the table."""
        raise NotImplementedError

    def make_objects(self) -> Sequence[Any]:
        """Cube and goal."""
        self.goal = self.make_goal()
        self.goal.get_obj().set("mocap", "true")
        return [*super().make_objects(), self.goal]

    def place_objects(self, rng: np.random.Generator) -> None:
        """Anywhere in the configured rectangle, ``gap`` apart, each with any yaw."""
        cube, goal = draw_two_places(rng, MIDDLE, self.config)
        cube_yaw, goal_yaw = rng.uniform(-np.pi, np.pi, 2)
        self.put_cube(cube, cube_yaw)
        self.put_goal(goal, goal_yaw)

    def put_goal(self, position: FloatArray, yaw: float) -> None:
        """Set the goal up.

        Args:
            position: (2,) of its middle in the workspace frame, metres.
            yaw: Radians about the vertical.
        """
        self.sim.data.set_mocap_pos(self.goal.root_body, TABLE_TOP + np.array([*position, 0.0]))
        self.sim.data.set_mocap_quat(self.goal.root_body, turn_about_z(yaw))

    def transform_goal_to_workspace(self) -> FloatArray:
        """(4, 4) of the goal: origin in its middle on the table, z up."""
        return self.transform_object_to_workspace(self.goal)

    def cube_in_goal_frame(self) -> FloatArray:
        """(3,) the cube's centre in the goal's frame, metres."""
        to_goal = invert(self.transform_goal_to_workspace())
        position: FloatArray = apply(to_goal, self.cube_position()[None])[0]
        return position
