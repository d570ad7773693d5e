"""The same law in one piece of machine code for each physics step.

It agrees with robosuite's to rounding, not to the bit: Jacobians come from the joints' axes, the inertia
matrix is read where MuJoCo keeps it, and small symmetric systems are solved instead of inverted.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np

from geoprior.errors import ConfigError
from geoprior.sim._osc_kernel import Operands, command_torques

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from geoprior.sim.robosuite_arm import RobosuiteArm

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]


class FastLaw:
    """See `geoprior.sim.control.TorqueLaw`.

    Args:
        arm: Of an environment that was reset.

    Raises:
        ConfigError: The hand is not moved by hinges of the arm alone.
    """

    def __init__(self, arm: RobosuiteArm) -> None:
        model, data, osc = arm.model, arm.data, arm.controller
        joints = np.array(osc.joint_index, dtype=np.int64)
        _require_hinges(model, joints, arm.hand_site)
        dofs = np.array(osc.qvel_index, dtype=np.int64)
        moves_base = np.isin(joints, _joints_that_move(model, arm.base_site))
        self._operands = Operands(
            positions=data.qpos,
            velocities=data.qvel,
            packed_inertia=data.qM,
            bias=data.qfrc_bias,
            anchors=data.xanchor,
            axes=data.xaxis,
            site_positions=data.site_xpos,
            site_rotations=data.site_xmat,
            controls=data.ctrl,
            joints=joints,
            angles=np.array(osc.qpos_index, dtype=np.int64),
            dofs=dofs,
            actuators=np.array(arm.actuators, dtype=np.int64),
            inertia_entries=_inertia_entries(model, dofs),
            moves_base=moves_base.astype(np.float64),
            hand=arm.hand_site,
            base=arm.base_site,
            stiffness=np.array(osc.kp, dtype=np.float64),
            damping=np.array(osc.kd, dtype=np.float64),
            rest=np.array(osc.initial_joint, dtype=np.float64),
            low=arm.low,
            high=arm.high,
        )

    def command(self, goal_position: FloatArray, goal_rotation: FloatArray) -> None:
        """Write the arm's torques."""
        command_torques(*self._operands, goal_position, goal_rotation)


def _inertia_entries(model: mujoco.MjModel, dofs: IntArray) -> IntArray:
    """(n, n) where the inertia matrix of some degrees of freedom stands in ``qM``.

    MuJoCo itself says so, in whatever way it packs the matrix: it unpacks the entries' own numbers.
    """
    numbers = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, numbers, np.arange(1.0, model.nM + 1.0))
    entries: IntArray = numbers[np.ix_(dofs, dofs)].astype(np.int64) - 1
    return entries


def _require_hinges(model: mujoco.MjModel, joints: IntArray, site: int) -> None:
    hinges = (model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE).all()
    if hinges and set(_joints_that_move(model, site)) == set(joints.tolist()):
        return
    raise ConfigError(
        "controller 'fast': the hand of this robot is moved by other joints than the hinges of its arm",
        "choose the controller 'exact'",
    )


def _joints_that_move(model: mujoco.MjModel, site: int) -> list[int]:
    """Numbers of the joints between the world and a site."""
    joints: list[int] = []
    body = int(model.site_bodyid[site])
    while body:
        first = int(model.body_jntadr[body])
        joints.extend(range(first, first + int(model.body_jntnum[body])))
        body = int(model.body_parentid[body])
    return joints
