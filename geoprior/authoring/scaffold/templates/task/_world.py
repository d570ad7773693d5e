"""The simulated world of the task, and its scripted expert. Lengths are metres in the workspace frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.sim.experts.path import Waypoint, follow
from geoprior.sim.worlds.tabletop import TABLE_TOP, Tabletop

from robosuite.models.objects import BallObject  # isort: skip - after geoprior has chosen the GL backend

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.authoring.scaffold.templates.task import MyPluginConfig
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting

LOW, HIGH = np.array([-0.08, -0.12, 0.06]), np.array([0.08, 0.12, 0.16])
"""Corners of the box in which the ball hangs."""


class MyPluginWorld(Tabletop):
    """A ball that is only looked at; see `geoprior.sim.worlds.tabletop.Tabletop`.

    Args:
        robot: The arm.
        setting: How it is seen and paced.
        config: The ball's size.
    """

    def __init__(self, robot: Robot, setting: Setting, config: MyPluginConfig) -> None:
        self.config = config
        super().__init__(robot, setting)

    def make_objects(self) -> Sequence[Any]:
        """The ball: no joint, and nothing collides with it."""
        ball = BallObject(
            name="ball",
            size=[self.config.radius],
            rgba=(0.9, 0.6, 0.1, 1.0),
            joints=None,
            obj_type="visual",
        )
        # A mocap body: its place is part of the simulation's state, and nothing moves it.
        ball.get_obj().set("mocap", "true")
        self.ball = ball
        return [ball]

    def place_objects(self, rng: np.random.Generator) -> None:
        """Hang the ball anywhere in its box."""
        self.sim.data.set_mocap_pos(self.ball.root_body, TABLE_TOP + rng.uniform(LOW, HIGH))

    def ball_position(self) -> NDArray[np.float64]:
        """(3,) its middle."""
        position: NDArray[np.float64] = self.sim.data.get_mocap_pos(self.ball.root_body) - TABLE_TOP
        return position

    def succeeded(self) -> bool:
        """The hand frame's origin, between the finger tips, is inside the ball."""
        hand = self.transform_hand_to_workspace()[:3, 3]
        return bool(np.linalg.norm(hand - self.ball_position()) < self.config.radius)


def expert(
    world: MyPluginWorld, start: NDArray[np.float32], rng: np.random.Generator
) -> Iterator[NDArray[np.float32]]:
    """Straight to the ball, at a speed that varies, and wait there; the rotation stays as it is."""
    rotation = Rotation.from_quat(start[3:7])
    there = Waypoint(world.ball_position(), rotation, 0.0, speed=rng.uniform(0.10, 0.16), wait=15)
    return follow(start, [there], world.control_freq)
