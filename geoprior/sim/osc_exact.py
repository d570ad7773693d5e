"""robosuite's operational-space law without the ceremony around it, equal to the last bit.

What it leaves out: every Jacobian computed three times, base velocities of an arm that is bolted down and
buffers of past forces. The arithmetic itself is robosuite's: its compiled functions are called with the same
operands in the same order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np

from geoprior.sim.backend import prepare_robosuite
from geoprior.sim.robosuite_arm import as_slice

prepare_robosuite()

from robosuite.utils.control_utils import (  # noqa: E402
    nullspace_torques,
    opspace_matrices,
    orientation_error,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.sim.robosuite_arm import RobosuiteArm

    FloatArray = NDArray[np.float64]

_AT_REST = (np.zeros(3), np.zeros(3))


class ExactLaw:
    """See `geoprior.sim.control.TorqueLaw`.

    Args:
        arm: Of an environment that was reset.
    """

    def __init__(self, arm: RobosuiteArm) -> None:
        self._model, self._data, self._controller = arm.model, arm.data, arm.controller
        self._site = arm.hand_site
        self._dofs = as_slice(arm.controller.qvel_index)
        self._angles = as_slice(arm.controller.qpos_index)
        self._actuators = as_slice(arm.actuators)
        self._low, self._high = arm.low, arm.high
        base_body = arm.model.site_bodyid[arm.base_site]
        self._moving_base = arm.base_site if arm.model.body_weldid[base_body] else None
        self._jacobian = np.zeros((6, arm.model.nv))
        self._inertia = np.zeros((arm.model.nv, arm.model.nv))

    def command(self, goal_position: FloatArray, goal_rotation: FloatArray) -> None:
        """Write the arm's torques."""
        torques = self._torques(goal_position, goal_rotation)
        self._data.ctrl[self._actuators] = np.minimum(np.maximum(torques, self._low), self._high)

    def _torques(self, goal_position: FloatArray, goal_rotation: FloatArray) -> FloatArray:
        """Khatib's operational-space law as `robosuite...osc.OperationalSpaceController` computes it."""
        model, data, osc = self._model, self._data, self._controller
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

        force = np.multiply(goal_position - data.site_xpos[self._site], osc.kp[:3])
        force = force + np.multiply(-(velocity - base_velocity), osc.kd[:3])
        torque = np.multiply(orientation_error(goal_rotation, rotation), osc.kp[3:])
        torque = torque + np.multiply(-(spin - base_spin), osc.kd[3:])
        _, lambda_position, lambda_rotation, nullspace = opspace_matrices(
            inertia, of_arm, of_arm[:3], of_arm[3:]
        )
        wrench = np.concatenate([np.dot(lambda_position, force), np.dot(lambda_rotation, torque)])
        torques = np.dot(of_arm.T, wrench) + data.qfrc_bias[self._dofs]
        torques += nullspace_torques(
            inertia, nullspace, osc.initial_joint, data.qpos[self._angles], data.qvel[self._dofs]
        )
        return np.asarray(torques)

    def _velocity(self, site: int) -> tuple[FloatArray, FloatArray]:
        """Of a site in the world; leaves its Jacobian in ``_jacobian``."""
        jacobian = self._jacobian
        mujoco.mj_jacSite(self._model, self._data, jacobian[:3], jacobian[3:], site)
        return np.dot(jacobian[:3], self._data.qvel), np.dot(jacobian[3:], self._data.qvel)
