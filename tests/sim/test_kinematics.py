from __future__ import annotations

import mujoco
import numpy as np
import pytest

from geoprior.errors import DataError
from geoprior.sim.kinematics import solve_joints

ARM = """
<mujoco><worldbody>
<body><joint name="a" axis="0 0 1"/><geom size=".02" pos=".2 0 0"/>
<body pos=".4 0 0"><joint name="b" axis="0 1 0"/><geom size=".02" pos=".2 0 0"/>
<body pos=".3 0 0"><joint name="c" axis="0 0 1"/><geom size=".02" pos=".1 0 0"/>
<body pos=".1 0 0"><joint name="d" axis="0 1 0"/><geom size=".02"/>
<body><joint name="e" axis="1 0 0"/><geom size=".02"/>
<body pos=".05 0 0"><joint name="f" axis="0 0 1"/><geom size=".02"/><site name="tip" pos=".1 0 0"/>
</body></body></body></body></body></body>
</worldbody></mujoco>
"""


@pytest.fixture
def arm():
    model = mujoco.MjModel.from_xml_string(ARM)
    return model, mujoco.MjData(model)


def _pose(model, data, angles) -> np.ndarray:
    data.qpos[:] = angles
    mujoco.mj_kinematics(model, data)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = data.site_xmat[0].reshape(3, 3), data.site_xpos[0]
    return pose


def test_solution_reaches_the_pose(arm):
    model, data = arm
    rng = np.random.default_rng(0)
    for _ in range(20):
        truth = rng.uniform(-0.8, 0.8, 6) + np.array([0.0, 0.3, 0.0, 0.9, 0.0, 0.0])
        wanted = _pose(model, data, truth)
        guess = truth + rng.uniform(-0.15, 0.15, 6)
        found = solve_joints(model, data, 0, range(6), wanted, guess)
        np.testing.assert_allclose(_pose(model, data, found), wanted, atol=2e-5)


def test_pose_out_of_reach_is_an_error(arm):
    model, data = arm
    wanted = np.eye(4)
    wanted[:3, 3] = [3.0, 0.0, 0.0]
    with pytest.raises(DataError, match="no joint angles"):
        solve_joints(model, data, 0, range(6), wanted, np.full(6, 0.3))
