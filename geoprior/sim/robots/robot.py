"""What the program knows of an arm: a handful of numbers beside robosuite's own model of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from pydantic import Field

from geoprior.options import Options

Matrix3 = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

IDENTITY: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class RobotConfig(Options):
    """How an arm is driven; all else is what its model says."""

    controller: Literal["fast", "exact"] = Field(
        "fast",
        description="`exact` steps as robosuite does, to the last bit; `fast` agrees to rounding and costs "
        "less (`python -m benchmarks rollout`).",
    )


@dataclass(frozen=True)
class Robot:
    """An arm with a two-finger gripper on a table-side mount.

    The hand frame sits in the grip centre between the finger tips. Its axes are [right, up, forward]:
    forward is the gripper's direction of approach, and the fingers open and close along right. When the
    hand points straight down with up along the workspace's +x (away from the robot), right is +y. The same
    pose vector therefore means the same placing of the fingers on every arm.

    Attributes:
        name: Registered name.
        robosuite_name: Name of the arm's model in robosuite.
        gripper: Name of the gripper's model in robosuite.
        home_joints: Joint angles in radians with the hand near the middle of the workspace, pointing down:
            the guess from which the start pose of an episode is solved, so that all of one arm's episodes
            begin in the same posture.
        rotation_hand_to_site: (3, 3) hand axes (columns) in the frame of robosuite's grip site.
        camera_position: (right, up, forward) in metres: where the hand camera sits in the hand frame.
        camera_pitch: Radians by which the hand camera is turned towards the finger tips, from looking
            along the hand's forward axis.
        closed_fingers: (right, up, forward) in metres: how wide the tips of the closed fingers are along
            right and along up, and how far they reach past the hand frame's origin along forward.
        controller: See `RobotConfig`.
    """

    name: str
    robosuite_name: str
    gripper: str
    home_joints: tuple[float, ...]
    rotation_hand_to_site: Matrix3 = IDENTITY
    camera_position: tuple[float, float, float] = (0.0, 0.06, -0.10)
    camera_pitch: float = 0.0
    closed_fingers: tuple[float, float, float] = (0.039, 0.022, 0.008)
    controller: str = "fast"

    def driven(self, config: RobotConfig) -> Robot:
        """The same arm with the controller that a config names: what a `RobotSpec` needs as its factory."""
        return replace(self, controller=config.controller)
