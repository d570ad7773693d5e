"""Joint angles for a wanted hand pose: damped least squares on MuJoCo's own kinematics."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

_STEPS = 60
_DAMPING = 1e-4
_TOLERANCE = 1e-7
_LONGEST_STEP = 0.2


def solve_joints(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    site: int,
    joints: Sequence[int],
    transform_site_to_world: FloatArray,
    guess: FloatArray,
) -> FloatArray:
    """Find joint angles that put a site into a pose, near a guess.

    Args:
        model: The model.
        data: Its ``qpos`` of ``joints`` is overwritten.
        site: Number of the site.
        joints: Numbers of hinge joints.
        transform_site_to_world: (4, 4) the wanted pose; metres.
        guess: (J,) radians to begin with; the solution found is the one that Newton's steps lead to.

    Returns:
        (J,) radians.

    Raises:
        DataError: The pose is out of reach (off by more than 1e-5 m or rad after 60 steps).
    """
    position_of = model.jnt_qposadr[list(joints)]
    velocity_of = model.jnt_dofadr[list(joints)]
    angles = np.array(guess, dtype=np.float64)
    jacobian = np.zeros((6, model.nv))
    error = np.full(6, np.inf)
    for _ in range(_STEPS):
        data.qpos[position_of] = angles
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        rotation = data.site_xmat[site].reshape(3, 3)
        turn = Rotation.from_matrix(transform_site_to_world[:3, :3] @ rotation.T).as_rotvec()
        error = np.concatenate([transform_site_to_world[:3, 3] - data.site_xpos[site], turn])
        if np.abs(error).max() < _TOLERANCE:
            return angles
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
        square = jacobian[:, velocity_of]
        step = square.T @ np.linalg.solve(square @ square.T + _DAMPING * np.eye(6), error)
        angles += step * min(1.0, _LONGEST_STEP / np.abs(step).max())
    if np.abs(error).max() > 1e-5:
        raise DataError(
            f"no joint angles put the hand at {np.round(transform_site_to_world[:3, 3], 3).tolist()} m: "
            f"{np.abs(error).max():.3f} m or rad away",
            "choose a start pose within the arm's reach",
        )
    return angles
