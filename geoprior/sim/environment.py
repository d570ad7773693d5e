"""One task and its arms: reset to a seed, command hand poses, look through the cameras."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.episode import POSE_SIZE, WORLD, CameraHeader
from geoprior.errors import ConfigError, DataError
from geoprior.geometry.camera import pinhole_intrinsics
from geoprior.geometry.se3 import (
    REFERENCE_QUATERNION,
    continuous_quaternions,
    transforms_of_poses,
)
from geoprior.geometry.seeding import generator
from geoprior.sim.appearance import Appearance
from geoprior.sim.config import SIMULATION_RATE
from geoprior.sim.control import PoseControl, require_controller
from geoprior.sim.meshes import lighten_meshes
from geoprior.sim.views import Eyes
from geoprior.sim.worlds.tabletop import TABLE_TOP, THIRD_CAMERA

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting
    from geoprior.sim.tasks.task import Task

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
        pose: (8 x hands) float32 pose vectors of the hands in the workspace frame; each one's last number is
            the gripper's last command, 0 open or 1 closed.
        images: Of every hand's camera, by the hand's name, and ``third``: (H, W, 3) uint8 RGB, top row first.
    """

    pose: NDArray[np.float32]
    images: Mapping[str, NDArray[np.uint8]]


class UnstablePhysicsError(Exception):
    """The simulated state is no longer finite; the episode is over and the environment can be reset."""


class Environment:
    """A task, its simulated arms and their cameras.

    An episode is a pure function of the state seed and the commands: the same on any worker, alone or after
    other episodes. Build it once in a process and reset it: building takes seconds.

    Args:
        robot: The arm, and how the task's arms are driven; see `geoprior.sim.control`.
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
        self.hands: tuple[str, ...] = self.world.hands
        self.eyes = eyes if eyes is not None else Eyes([*self.hands, THIRD_CAMERA])
        self._state_seed = -1
        self._forget()
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
        self._forget()
        self._locate()
        if self.world.succeeded():
            raise DataError(
                f"task {self.task.name!r}: the initial state of seed {state_seed} already counts as success",
                "change the task's options so that its goal is not met at the start",
            )

    def step(self, command: NDArray[np.float32]) -> None:
        """Command hand poses and let one control interval pass.

        Args:
            command: (8 x hands) finite pose vectors in the workspace frame; a gripper closes from 0.5 on.

        Raises:
            UnstablePhysicsError: Positions, velocities or forces are no longer finite.
        """
        assert self._control is not None, "reset first"
        for hand, pose in self._by_hand(command):
            self._gripper[hand] = 1.0 if pose[7] >= 0.5 else 0.0
        try:
            self._control.advance(self.action_of(command))
        except np.linalg.LinAlgError as error:
            raise UnstablePhysicsError(str(error)) from error
        if any(self._data.warning[kind].number for kind in _UNSTABLE):
            raise UnstablePhysicsError("MuJoCo had to put its state back")
        self._locate()

    def action_of(self, command: NDArray[np.float32]) -> FloatArray:
        """The action (7 x hands) of robosuite for pose vectors (8 x hands)."""
        action: list[float] = []
        for hand, pose in self._by_hand(command):
            transform = transforms_of_poses(pose)
            rotation = transform[:3, :3] @ np.array(self.world.arms[hand].robot.rotation_hand_to_site).T
            closing = 1.0 if pose[7] >= 0.5 else -1.0
            action += [*(transform[:3, 3] + TABLE_TOP), *Rotation.from_matrix(rotation).as_rotvec(), closing]
        return np.array(action)

    def pose(self) -> NDArray[np.float32]:
        """(8 x hands) pose vectors of the hands now."""
        numbers: list[float] = []
        for hand in self.hands:
            position = self.world.transform_hand_to_workspace(hand)[:3, 3]
            numbers += [*position, *self._quaternion[hand], self._gripper[hand]]
        return np.array(numbers, dtype=np.float32)

    def render(self) -> dict[str, NDArray[np.uint8]]:
        """Frames of all cameras now."""
        return self.eyes.draw(self._model, self._data, self.cameras.height, self.cameras.width)

    def observe(self) -> Observation:
        """Pose and frames now. Frames are drawn only here and in `render`."""
        return Observation(self.pose(), self.render())

    def expert(self, seed: int) -> Iterator[NDArray[np.float32]]:
        """The scripted expert's commands for the episode just reset; its variation is the root seed's."""
        rng = generator(seed, "expert", self.task.name, self._state_seed)
        return self.task.expert(self.world, self.pose(), rng)

    def camera_headers(self) -> list[CameraHeader]:
        """The cameras as an episode's header describes them."""
        lenses = self.cameras
        mounts = {
            hand: (hand, self.world.transform_camera_to_hand(hand), lenses.hand.vertical_fov)
            for hand in self.hands
        }
        fixed = self.world.transform_camera_to_workspace()
        mounts[THIRD_CAMERA] = (WORLD, fixed, lenses.third.vertical_fov)
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
        """(size, cameras x size, 3) RGB: the third camera's view beside the hands', for people to look at."""
        frames = self.eyes.draw(self._model, self._data, size, size)
        return np.hstack([frames[THIRD_CAMERA], *(frames[hand] for hand in self.hands)])

    def close(self) -> None:
        """Free the rendering contexts."""
        self.eyes.close()

    def _locate(self) -> None:
        """Bring positions up to date with the joints; robosuite's lag one physics step behind."""
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        for hand, before in self._quaternion.items():
            rotation = Rotation.from_matrix(self.world.transform_hand_to_workspace(hand)[:3, :3])
            self._quaternion[hand] = continuous_quaternions(rotation.as_quat()[None], before)[0]

    def _forget(self) -> None:
        """Open grippers, and no orientation before the present one."""
        self._gripper = dict.fromkeys(self.hands, 0.0)
        self._quaternion = dict.fromkeys(self.hands, REFERENCE_QUATERNION)

    def _by_hand(self, command: NDArray[np.float32]) -> Iterator[tuple[str, NDArray[np.float32]]]:
        """Each hand's part (8,) of a command (8 x hands)."""
        return zip(self.hands, command.reshape(-1, POSE_SIZE), strict=True)


def _ignore(message: str) -> None:
    """MuJoCo's warnings are counted in its data."""
