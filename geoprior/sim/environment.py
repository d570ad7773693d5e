"""One task on one arm: reset to a seed, command hand poses, look through the two cameras."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.errors import ConfigError, DataError
from geoprior.geometry.camera import pinhole_intrinsics
from geoprior.geometry.se3 import (
    REFERENCE_QUATERNION,
    continuous_quaternions,
    transforms_of_poses,
)
from geoprior.geometry.seeding import generator
from geoprior.shards.episode import CameraHeader
from geoprior.sim.appearance import Appearance
from geoprior.sim.config import SIMULATION_RATE
from geoprior.sim.control import PoseControl, require_controller
from geoprior.sim.meshes import lighten_meshes
from geoprior.sim.views import Eyes
from geoprior.sim.worlds.tabletop import HAND_CAMERA, TABLE_TOP, THIRD_CAMERA

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.tasks.task import Task

HAND = "hand"
"""Name of the one hand in headers and mounts."""

_UNSTABLE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
    mujoco.mjtWarning.mjWARN_BADCTRL,
)


@dataclass(frozen=True)
class Observation:
    """What a policy sees.

    Attributes:
        pose: (8,) float32 pose vector of the hand in the workspace frame; its last number is the gripper's
            last command, 0 open or 1 closed.
        images: ``hand`` and ``third``, (H, W, 3) uint8 RGB, top row first.
    """

    pose: NDArray[np.float32]
    images: Mapping[str, NDArray[np.uint8]]


class UnstablePhysicsError(Exception):
    """The simulated state is no longer finite; the episode is over and the environment can be reset."""


class Environment:
    """A simulated arm, a task and two cameras.

    An episode is a pure function of the state seed and the commands: the same on any worker, alone or after
    other episodes. Build it once in a process and reset it: building takes seconds.

    Args:
        robot: The arm, and how it is driven; see `geoprior.sim.control`.
        task: The task.
        setting: How it is seen and paced.
        eyes: Rendering contexts that several environments of the same arm, task and setting share; its own
            ones by default.

    Raises:
        ConfigError: The control rate does not divide the physics rate, or there is no such controller.
        MachineError: No GL, or robosuite cannot be used.
    """

    def __init__(self, robot: Robot, task: Task, setting: Setting, eyes: Eyes | None = None) -> None:
        if SIMULATION_RATE % setting.control_rate:
            raise ConfigError(
                f"control_rate {setting.control_rate}: it must divide the physics' rate, {SIMULATION_RATE}",
                "choose 10, 20, 25 or 50",
            )
        # What goes wrong inside a step is read from counters; a log file in the working folder helps nobody.
        mujoco.set_mju_user_warning(_ignore)
        self.robot, self.task, self.setting = robot, task, setting
        self.cameras, self.control_rate = setting.cameras, setting.control_rate
        self.controller = require_controller(robot.controller)
        self.world = task.make(robot, setting)
        self._model, self._data = self.world.sim.model._model, self.world.sim.data._data
        lighten_meshes(self._model, setting.cameras.height)
        self._appearance = Appearance(self._model)
        self.eyes = eyes if eyes is not None else Eyes([HAND_CAMERA, THIRD_CAMERA])
        self._state_seed = -1
        self._gripper = 0.0
        self._quaternion = REFERENCE_QUATERNION
        self._control: PoseControl | None = None

    @property
    def seconds(self) -> float:
        """Simulated time since the reset."""
        return float(self._data.time)

    def reset(self, state_seed: int) -> None:
        """Put everything into the initial state of a seed.

        Raises:
            DataError: The initial state counts as success: the task's rule cannot be used on it.
        """
        self.world.state_seed = self._state_seed = state_seed
        self._appearance.restore()
        self.world.reset()
        self.setting.look.dress(self._model, self._data, generator(state_seed, "state", "look"))
        self._control = PoseControl(self.world, self.controller)
        self._gripper, self._quaternion = 0.0, REFERENCE_QUATERNION
        self._locate()
        if self.world.succeeded():
            raise DataError(
                f"task {self.task.name!r}: the initial state of seed {state_seed} already counts as success",
                "change the task's options so that its goal is not met at the start",
            )

    def step(self, command: NDArray[np.float32]) -> None:
        """Command a hand pose and let one control interval pass.

        Args:
            command: (8,) finite pose vector in the workspace frame; the gripper closes from 0.5 on.

        Raises:
            UnstablePhysicsError: Positions, velocities or forces are no longer finite.
        """
        assert self._control is not None, "reset first"
        self._gripper = 1.0 if command[7] >= 0.5 else 0.0
        try:
            self._control.advance(self.action_of(command))
        except np.linalg.LinAlgError as error:
            raise UnstablePhysicsError(str(error)) from error
        if any(self._data.warning[kind].number for kind in _UNSTABLE):
            raise UnstablePhysicsError("MuJoCo had to put its state back")
        self._locate()

    def action_of(self, command: NDArray[np.float32]) -> FloatArray:
        """The action (7,) of robosuite for a pose vector (8,)."""
        transform = transforms_of_poses(command)
        rotation = transform[:3, :3] @ np.array(self.robot.rotation_hand_to_site).T
        closing = 1.0 if command[7] >= 0.5 else -1.0
        return np.array(
            [*(transform[:3, 3] + TABLE_TOP), *Rotation.from_matrix(rotation).as_rotvec(), closing]
        )

    def pose(self) -> NDArray[np.float32]:
        """(8,) pose vector of the hand now."""
        position = self.world.transform_hand_to_workspace()[:3, 3]
        return np.array([*position, *self._quaternion, self._gripper], dtype=np.float32)

    def render(self) -> dict[str, NDArray[np.uint8]]:
        """Frames of both cameras now."""
        return self.eyes.draw(self._model, self._data, self.cameras.height, self.cameras.width)

    def observe(self) -> Observation:
        """Pose and frames now. Frames are drawn only here and in `render`."""
        return Observation(self.pose(), self.render())

    def expert(self, seed: int) -> Iterator[NDArray[np.float32]]:
        """The scripted expert's commands for the episode just reset; its variation is the root seed's."""
        rng = generator(seed, "expert", self.task.name, self._state_seed)
        return self.task.expert(self.world, self.pose(), rng)

    def camera_headers(self) -> list[CameraHeader]:
        """Both cameras as an episode's header describes them."""
        mounts = {
            HAND_CAMERA: (HAND, self.world.transform_camera_to_hand(), self.cameras.hand.vertical_fov),
            THIRD_CAMERA: (
                "world",
                self.world.transform_camera_to_workspace(),
                self.cameras.third.vertical_fov,
            ),
        }
        height, width = self.cameras.height, self.cameras.width
        return [
            CameraHeader(
                name=name,
                height=height,
                width=width,
                channels=3,
                intrinsics=pinhole_intrinsics(height, width, fov).tolist(),
                mount=mount,
                transform_camera_to_mount=transform.tolist(),
            )
            for name, (mount, transform, fov) in sorted(mounts.items())
        ]

    def film_frame(self, size: int) -> NDArray[np.uint8]:
        """(size, 2 x size, 3) RGB: the third camera's view beside the hand's, for people to look at."""
        frames = self.eyes.draw(self._model, self._data, size, size)
        return np.hstack([frames[THIRD_CAMERA], frames[HAND_CAMERA]])

    def close(self) -> None:
        """Free the rendering contexts."""
        self.eyes.close()

    def _locate(self) -> None:
        """Bring positions up to date with the joints; robosuite's lag one physics step behind."""
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        rotation = Rotation.from_matrix(self.world.transform_hand_to_workspace()[:3, :3])
        self._quaternion = continuous_quaternions(rotation.as_quat()[None], self._quaternion)[0]


def _ignore(message: str) -> None:
    """MuJoCo's warnings are counted in its data."""
