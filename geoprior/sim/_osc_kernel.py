"""Khatib's operational-space law for one arm, in machine code.

The law is that of `robosuite.controllers.parts.arm.osc.OperationalSpaceController` with position and
orientation uncoupled. Positions and rotations are in the world frame, metres and radians; forces in newtons,
torques in newton metres. Sums are plain loops, always in the same order: no linear-algebra library has a say
in the result, save where a matrix is nearly singular.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from geoprior.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

REST_STIFFNESS = 10.0
REST_DAMPING = 2.0 * np.sqrt(REST_STIFFNESS)
"""Of the pull to the rest posture, where the hand does not feel it; robosuite's numbers."""

SMALLEST_PIVOT = 1e-8
"""Of a Cholesky factorisation, relative to the largest diagonal entry. Below it robosuite's pseudo-inverse
takes over: rounding would no longer leave the two equal."""


class Operands(NamedTuple):
    """What the law reads of MuJoCo's state, shared with it and not copied, and of an arm with n hinges.

    The state is that which `mujoco.mj_step1` leaves.

    Attributes:
        positions: ``qpos``.
        velocities: ``qvel``.
        packed_inertia: ``qM``, the entries of the inertia matrix that are not zero.
        bias: ``qfrc_bias``, gravity, centrifugal and Coriolis forces.
        anchors: ``xanchor``, (J, 3) a point on every joint's axis.
        axes: ``xaxis``, (J, 3) directions of the axes.
        site_positions: ``site_xpos``, (S, 3).
        site_rotations: ``site_xmat``, (S, 9).
        controls: ``ctrl``; the torques are written here.
        joints: (n,) numbers of the hinges, from the base on.
        angles: (n,) where their angles stand in ``qpos``.
        dofs: (n,) where their speeds stand in ``qvel``.
        actuators: (n,) where their torques stand in ``ctrl``.
        inertia_entries: (n, n) where the arm's inertia matrix stands in ``qM``.
        moves_base: (n,) 1.0 for hinges that move the site which robosuite takes for the base, else 0.0.
        hand: Number of the site to control.
        base: Number of the base's site.
        stiffness: (6,) robosuite's ``kp``: of position, then of orientation.
        damping: (6,) robosuite's ``kd``.
        rest: (n,) angles of the rest posture.
        low: (n,) smallest torques.
        high: (n,) largest torques.
    """

    positions: FloatArray
    velocities: FloatArray
    packed_inertia: FloatArray
    bias: FloatArray
    anchors: FloatArray
    axes: FloatArray
    site_positions: FloatArray
    site_rotations: FloatArray
    controls: FloatArray
    joints: IntArray
    angles: IntArray
    dofs: IntArray
    actuators: IntArray
    inertia_entries: IntArray
    moves_base: FloatArray
    hand: int
    base: int
    stiffness: FloatArray
    damping: FloatArray
    rest: FloatArray
    low: FloatArray
    high: FloatArray


@compiled
def command_torques(  # noqa: D417 - the rest are described in Operands
    positions: FloatArray,
    velocities: FloatArray,
    packed_inertia: FloatArray,
    bias: FloatArray,
    anchors: FloatArray,
    axes: FloatArray,
    site_positions: FloatArray,
    site_rotations: FloatArray,
    controls: FloatArray,
    joints: IntArray,
    angles: IntArray,
    dofs: IntArray,
    actuators: IntArray,
    inertia_entries: IntArray,
    moves_base: FloatArray,
    hand: int,
    base: int,
    stiffness: FloatArray,
    damping: FloatArray,
    rest: FloatArray,
    low: FloatArray,
    high: FloatArray,
    goal_position: FloatArray,
    goal_rotation: FloatArray,
) -> None:
    """Write the torques that pull the hand to its goal, within their limits.

    The fields of `Operands` come one by one: they reach machine code in half the time of a tuple.

    Args:
        goal_position: (3,) of the hand's site.
        goal_rotation: (3, 3) of the hand's site, C order.

    Raises:
        numpy.linalg.LinAlgError: The inertia matrix is not positive definite, or the state is not finite.
    """
    size = joints.shape[0]
    inertia, jacobian = np.empty((size, size)), np.empty((6, size))
    velocity, to_rest = np.zeros(6), np.empty(size)
    for column in range(size):
        joint, speed = joints[column], velocities[dofs[column]]
        swing = _swing(axes[joint], anchors[joint], site_positions[hand])
        base_swing = _swing(axes[joint], anchors[joint], site_positions[base])
        for row in range(6):
            jacobian[row, column] = swing[row]
            velocity[row] += (swing[row] - moves_base[column] * base_swing[row]) * speed
        to_rest[column] = REST_STIFFNESS * (rest[column] - positions[angles[column]]) - REST_DAMPING * speed
        for row in range(size):
            inertia[row, column] = packed_inertia[inertia_entries[row, column]]

    error = _error(site_positions[hand], site_rotations[hand], goal_position, goal_rotation)
    acceleration = stiffness * error - damping * velocity
    mobility = _mobility(inertia, jacobian)
    wrench = np.empty(6)
    wrench[:3] = _solve(mobility[:3, :3].copy(), acceleration[:3])
    wrench[3:] = _solve(mobility[3:, 3:].copy(), acceleration[3:])
    # Of the pull to the rest posture, the part that would move the hand is taken away:
    # (1 - J^T Lambda J M^-1) M p = M p - J^T Lambda (J p).
    wrench -= _solve(mobility, _times(jacobian, to_rest))
    torques = _times(inertia, to_rest)
    for column in range(size):
        torque = bias[dofs[column]] + torques[column]
        for row in range(6):
            torque += jacobian[row, column] * wrench[row]
        if not np.isfinite(torque):
            raise np.linalg.LinAlgError("the torque of a joint is not finite")
        controls[actuators[column]] = min(max(torque, low[column]), high[column])


@compiled
def _swing(
    axis: FloatArray, anchor: FloatArray, point: FloatArray
) -> tuple[float, float, float, float, float, float]:
    """Velocity and spin of a point that turns about an axis with one radian a second."""
    x, y, z = point[0] - anchor[0], point[1] - anchor[1], point[2] - anchor[2]
    return (
        axis[1] * z - axis[2] * y,
        axis[2] * x - axis[0] * z,
        axis[0] * y - axis[1] * x,
        axis[0],
        axis[1],
        axis[2],
    )


@compiled
def _error(
    position: FloatArray, rotation: FloatArray, goal_position: FloatArray, goal_rotation: FloatArray
) -> FloatArray:
    """(6,) what is left to the goal: metres, then half the sum of the axes' cross products."""
    error = np.zeros(6)
    for axis in range(3):
        x, y, z = rotation[axis], rotation[3 + axis], rotation[6 + axis]
        error[axis] = goal_position[axis] - position[axis]
        error[3] += 0.5 * (y * goal_rotation[2, axis] - z * goal_rotation[1, axis])
        error[4] += 0.5 * (z * goal_rotation[0, axis] - x * goal_rotation[2, axis])
        error[5] += 0.5 * (x * goal_rotation[1, axis] - y * goal_rotation[0, axis])
    return error


@compiled
def _mobility(inertia: FloatArray, jacobian: FloatArray) -> FloatArray:
    """(6, 6) how the hand yields to a wrench: J M^-1 J^T, the inverse of robosuite's lambda."""
    size = inertia.shape[0]
    lower = np.empty((size, size))
    if not _factorise(inertia, lower, 0.0):
        raise np.linalg.LinAlgError("the inertia matrix is not positive definite")
    half, mobility = np.empty((6, size)), np.empty((6, 6))
    for row in range(6):
        _solve_lower(lower, jacobian[row], half[row])
        for column in range(row + 1):
            total = 0.0
            for joint in range(size):
                total += half[row, joint] * half[column, joint]
            mobility[row, column] = mobility[column, row] = total
    return mobility


@compiled
def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve for a symmetric, positive semidefinite matrix, by its pseudo-inverse where it is singular."""
    size = matrix.shape[0]
    lower = np.empty((size, size))
    if not _factorise(matrix, lower, SMALLEST_PIVOT):
        return _times(np.linalg.pinv(matrix), right)
    solution = np.empty(size)
    _solve_lower(lower, right, solution)
    for row in range(size - 1, -1, -1):
        for column in range(row + 1, size):
            solution[row] -= lower[column, row] * solution[column]
        solution[row] /= lower[row, row]
    return solution


@compiled
def _factorise(matrix: FloatArray, lower: FloatArray, smallest: float) -> bool:
    """Cholesky: fill the lower triangle L of L L^T; False where a pivot is too small or not a number."""
    size = matrix.shape[0]
    largest = 0.0
    for row in range(size):
        largest = max(largest, matrix[row, row])
    for column in range(size):
        for row in range(column, size):
            total = matrix[row, column]
            for before in range(column):
                total -= lower[row, before] * lower[column, before]
            lower[row, column] = total
        pivot = lower[column, column]
        if not pivot > smallest * largest:
            return False
        for row in range(column, size):
            lower[row, column] /= np.sqrt(pivot)
    return True


@compiled
def _solve_lower(lower: FloatArray, right: FloatArray, solution: FloatArray) -> None:
    """Forward substitution."""
    for row in range(lower.shape[0]):
        total = right[row]
        for column in range(row):
            total -= lower[row, column] * solution[column]
        solution[row] = total / lower[row, row]


@compiled
def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Matrix times vector."""
    product = np.zeros(matrix.shape[0])
    for row in range(matrix.shape[0]):
        for column in range(matrix.shape[1]):
            product[row] += matrix[row, column] * vector[column]
    return product
