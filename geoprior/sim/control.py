"""robosuite's operational-space control and stepping, without the ceremony around it.

`advance` leaves the simulation in the state that ``env.step`` would leave it in, to the last bit (a test
holds that). What it leaves out: every Jacobian computed three times, base velocities of an arm that is
bolted down, buffers of past forces, observables, rewards and checks of the action's size at every one of the
50 physics steps of a command. The arithmetic itself is robosuite's: its compiled functions are called with
the same operands in the same order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.sim.backend import prepare_robosuite

prepare_robosuite()

from robosuite.utils.control_utils import (  # noqa: E402
    nullspace_torques,
    opspace_matrices,
    orientation_error,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

ARM = "right"
_AT_REST = (np.zeros(3), np.zeros(3))


class PoseControl:
    """Drives one reset robosuite environment by absolute world poses of the grip site.

    Args:
        env: Reset; make a new `PoseControl` after every reset, as robosuite makes new controllers.
    """

    def __init__(self, env: Any) -> None:
        robot = env.robots[0]
        self._model, self._data = env.sim.model._model, env.sim.data._data
        self._substeps = int(env.control_timestep / env.model_timestep)
        self._arm = robot.part_controllers[ARM]
        self._fingers = robot.part_controllers[robot.get_gripper_name(ARM)]
        self._gripper = robot.gripper[ARM]
        self._site = self._model.site(self._arm.ref_name).id
        # Slices where the numbers are consecutive, as on every arm so far: numpy is then ten times faster.
        self._dofs = _as_slice(self._arm.qvel_index)
        self._angles = _as_slice(self._arm.qpos_index)
        self._arm_actuators = _as_slice(robot._ref_actuators_indexes_dict[ARM])
        self._finger_actuators = _as_slice(robot._ref_actuators_indexes_dict[robot.get_gripper_name(ARM)])
        self._low, self._high = self._model.actuator_ctrlrange[self._arm_actuators].T.copy()
        self._finger_range = self._model.actuator_ctrlrange[self._finger_actuators]
        self._just_reset = True
        # On some arms (xArm7) the "base" site rides on the first moving link.
        base = self._model.site(f"{self._arm.naming_prefix}{self._arm.part_name}_center")
        self._moving_base = base.id if self._model.body_weldid[base.bodyid[0]] else None
        self._jacobian = np.zeros((6, self._model.nv))
        self._inertia = np.zeros((self._model.nv, self._model.nv))

    def advance(self, action: FloatArray) -> None:
        """Run the physics for one command.

        Args:
            action: (7,) robosuite's: position of the grip site in the world frame, its rotation vector,
                and the gripper, -1 to open and 1 to close.
        """
        goal_position = action[:3]
        goal_rotation = Rotation.from_rotvec(action[3:6]).as_matrix()
        fingers = self._finger_targets(action[6:])
        for _ in range(self._substeps):
            mujoco.mj_step1(self._model, self._data)
            if self._just_reset:
                torques = self._first_torques(action[:6])
            else:
                torques = self._arm_torques(goal_position, goal_rotation)
            self._data.ctrl[self._arm_actuators] = np.minimum(np.maximum(torques, self._low), self._high)
            self._data.ctrl[self._finger_actuators] = fingers
            mujoco.mj_step2(self._model, self._data)

    def _first_torques(self, goal: FloatArray) -> FloatArray:
        """The torques of robosuite's own controller object.

        Its first physics step after a reset uses the inertia from before the fingers were set.
        """
        self._just_reset = False
        self._arm.set_goal(goal)
        return np.asarray(self._arm.run_controller())

    def _finger_targets(self, action: FloatArray) -> FloatArray:
        self._fingers.set_goal(self._gripper.format_action(action))
        targets = self._fingers.run_controller()
        return np.asarray(np.clip(targets, self._finger_range[:, 0], self._finger_range[:, 1]))

    def _arm_torques(self, goal_position: FloatArray, goal_rotation: FloatArray) -> FloatArray:
        """Khatib's operational-space law as `robosuite...osc.OperationalSpaceController` computes it."""
        model, data, arm = self._model, self._data, self._arm
        jacobian = self._jacobian
        base_velocity, base_spin = (
            self._velocity(self._moving_base) if self._moving_base is not None else _AT_REST
        )
        velocity, spin = self._velocity(self._site)
        of_arm = np.ascontiguousarray(jacobian[:, self._dofs])
        rotation = np.array(data.site_xmat[self._site].reshape(3, 3))
        mujoco.mj_fullM(model, self._inertia, data.qM)
        # In Fortran's order, as robosuite's indexing leaves it: the compiled functions round accordingly.
        inertia = np.asfortranarray(self._inertia[self._dofs, :][:, self._dofs])

        force = np.multiply(goal_position - data.site_xpos[self._site], arm.kp[:3])
        force = force + np.multiply(-(velocity - base_velocity), arm.kd[:3])
        torque = np.multiply(orientation_error(goal_rotation, rotation), arm.kp[3:])
        torque = torque + np.multiply(-(spin - base_spin), arm.kd[3:])
        _, lambda_position, lambda_rotation, nullspace = opspace_matrices(
            inertia, of_arm, of_arm[:3], of_arm[3:]
        )
        wrench = np.concatenate([np.dot(lambda_position, force), np.dot(lambda_rotation, torque)])
        torques = np.dot(of_arm.T, wrench) + data.qfrc_bias[self._dofs]
        torques += nullspace_torques(
            inertia, nullspace, arm.initial_joint, data.qpos[self._angles], data.qvel[self._dofs]
        )
        return np.asarray(torques)

    def _velocity(self, site: int) -> tuple[FloatArray, FloatArray]:
        """Of a site in the world; leaves its Jacobian in ``_jacobian``."""
        jacobian = self._jacobian
        mujoco.mj_jacSite(self._model, self._data, jacobian[:3], jacobian[3:], site)
        return np.dot(jacobian[:3], self._data.qvel), np.dot(jacobian[3:], self._data.qvel)


def _as_slice(numbers: Any) -> slice | list[int]:
    first, last = int(numbers[0]), int(numbers[-1])
    consecutive = [int(number) for number in numbers] == list(range(first, last + 1))
    return slice(first, last + 1) if consecutive else [int(number) for number in numbers]
