"""Stepping arms by hand poses: the timing of robosuite's ``env.step``, around a law for the torques.

With the law `exact`, `PoseControl.advance` leaves the simulation in the state that ``env.step`` would leave
it in, to the last bit; with `fast`, to rounding, in a fraction of the time. Tests hold both. What both leave
out: observables, rewards and checks of the action's size at every one of the 50 physics steps of a command.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.errors import ConfigError
from geoprior.sim.osc_exact import ExactLaw
from geoprior.sim.osc_fast import FastLaw
from geoprior.sim.robosuite_arm import ARM, RobosuiteArm, as_slice

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]


class TorqueLaw(Protocol):
    """What the arm's motors do at a physics step."""

    def command(self, goal_position: FloatArray, goal_rotation: FloatArray) -> None:
        """Write the arm's torques, within their limits, into MuJoCo's ``ctrl``.

        Called between ``mj_step1`` and ``mj_step2``.

        Args:
            goal_position: (3,) of the grip site in the world frame, metres.
            goal_rotation: (3, 3) of the grip site in the world frame, C order.

        Raises:
            numpy.linalg.LinAlgError: The state gives no finite torques.
        """
        ...


LAWS: dict[str, Callable[[RobosuiteArm], TorqueLaw]] = {"exact": ExactLaw, "fast": FastLaw}


class PoseControl:
    """Drives the arms of one reset robosuite environment by absolute world poses of their grip sites.

    Args:
        env: Reset; make a new `PoseControl` after every reset, as robosuite makes new controllers.
        controller: One of `LAWS`, for every arm.
    """

    def __init__(self, env: Any, controller: str = "exact") -> None:
        self._model, self._data = env.sim.model._model, env.sim.data._data
        self._substeps = int(env.control_timestep / env.model_timestep)
        self._arms = [_ArmControl(env, robot, controller) for robot in env.robots]

    def advance(self, action: FloatArray) -> None:
        """Run the physics for one command.

        Args:
            action: (7 x arms) robosuite's: for each arm the position of the grip site in the world frame, its
                rotation vector, and the gripper, -1 to open and 1 to close.

        Raises:
            numpy.linalg.LinAlgError: The state gives no finite torques.
        """
        for arm, part in zip(self._arms, action.reshape(len(self._arms), -1), strict=True):
            arm.aim(part)
        for _ in range(self._substeps):
            mujoco.mj_step1(self._model, self._data)
            for arm in self._arms:
                arm.drive()
            mujoco.mj_step2(self._model, self._data)


class _ArmControl:
    """One arm and its fingers."""

    def __init__(self, env: Any, robot: Any, controller: str) -> None:
        gripper = robot.get_gripper_name(ARM)
        arm = RobosuiteArm.of(env, robot)
        self._osc, self._controls = arm.controller, arm.data.ctrl
        self._arm_actuators, self._low, self._high = arm.actuators, arm.low, arm.high
        self._fingers = robot.part_controllers[gripper]
        self._gripper = robot.gripper[ARM]
        self._finger_actuators = as_slice(robot._ref_actuators_indexes_dict[gripper])
        self._finger_range = arm.model.actuator_ctrlrange[self._finger_actuators]
        self._just_reset = True
        self._law = LAWS[controller](arm)

    def aim(self, action: FloatArray) -> None:
        """Take the next command (7,)."""
        self._goal = action[:6]
        self._goal_position = action[:3]
        self._goal_rotation = Rotation.from_rotvec(action[3:6]).as_matrix()
        self._finger_targets = self._targets(action[6:])

    def drive(self) -> None:
        """Write torques and finger targets into ``ctrl``, between ``mj_step1`` and ``mj_step2``."""
        if self._just_reset:
            self._command_first()
        else:
            self._law.command(self._goal_position, self._goal_rotation)
        self._controls[self._finger_actuators] = self._finger_targets

    def _command_first(self) -> None:
        """Write the torques of robosuite's own controller object.

        Its first physics step after a reset uses the inertia from before the fingers were set.
        """
        self._just_reset = False
        self._osc.set_goal(self._goal)
        torques = np.asarray(self._osc.run_controller())
        self._controls[self._arm_actuators] = np.clip(torques, self._low, self._high)

    def _targets(self, action: FloatArray) -> FloatArray:
        self._fingers.set_goal(self._gripper.format_action(action))
        targets = self._fingers.run_controller()
        return np.asarray(np.clip(targets, self._finger_range[:, 0], self._finger_range[:, 1]))


def require_controller(name: str) -> str:
    """Give the name back.

    Raises:
        ConfigError: It is none of `LAWS`.
    """
    if name not in LAWS:
        raise ConfigError(f"unknown controller {name!r}", f"choose {' or '.join(LAWS)}")
    return name
