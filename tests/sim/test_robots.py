from __future__ import annotations

import re

import mujoco
import numpy as np
import pytest

from geoprior.geometry.se3 import apply, invert, transforms_of_poses
from geoprior.options import Choice
from geoprior.sim.workers import Setup, environment

ARMS = ("ur5e", "xarm7", "kinova3")
PADS = {
    "ur5e": ("gripper0_right_left_fingerpad_collision", "gripper0_right_right_fingerpad_collision"),
    "kinova3": ("gripper0_right_left_fingerpad_collision", "gripper0_right_right_fingerpad_collision"),
    "xarm7": ("gripper0_right_left_finger_pad_1", "gripper0_right_right_finger_pad_1"),
}


@pytest.fixture(scope="module")
def arms(env, pick, cameras):
    others = {name: environment(Setup(Choice(name=name), pick, cameras), 10) for name in ARMS[1:]}
    return {"ur5e": env, **others}


def _settle(env, command: np.ndarray, steps: int = 25) -> np.ndarray:
    for _ in range(steps):
        env.step(command)
    return env.pose()


def test_same_numbers_mean_the_same_hand_pose_on_every_arm(arms):
    tilt = np.array([0.0, 0.0, 0.15, 0.6532815, 0.6532815, 0.2705981, -0.2705981, 0.0], dtype=np.float32)
    turned = np.array([0.05, -0.08, 0.2, 0.8314696, 0.5555702, 0.0, 0.0, 0.0], dtype=np.float32)
    for command in (turned, tilt):
        wanted = transforms_of_poses(command)
        for name, env in arms.items():
            env.reset(0)
            reached = transforms_of_poses(_settle(env, command))
            # The xArm7 keeps a steady error of some 8 mm: the controller has no integral part.
            assert np.abs(reached[:3, 3] - wanted[:3, 3]).max() < 0.012, name
            assert np.abs(reached[:3, :3] - wanted[:3, :3]).max() < 0.05, name


def test_start_poses_are_equal_on_every_arm(arms):
    poses = []
    for env in arms.values():
        env.reset(11)
        poses.append(env.pose())
    np.testing.assert_allclose(poses[1], poses[0], atol=1e-6)
    np.testing.assert_allclose(poses[2], poses[0], atol=1e-6)


@pytest.mark.parametrize("name", ARMS)
def test_hand_frame_fits_the_fingers(arms, name):
    """Judged by the model's bodies, not by the site: fingers along right, the palm behind along forward."""
    env = arms[name]
    env.reset(5)
    model, data = env.world.sim.model, env.world.sim.data
    to_hand = invert(env.world.transform_hand_to_workspace())
    offset = np.array([0.0, 0.0, 0.8])
    pads = np.array([data.geom_xpos[model.geom_name2id(pad)] for pad in PADS[name]]) - offset
    left, right = apply(to_hand, pads)
    assert abs(left[0] - right[0]) > 0.07
    assert np.abs(left[1:] - right[1:]).max() < 0.004
    palm = np.array([data.body_xpos[model.body_name2id("robot0_right_hand")]]) - offset
    assert apply(to_hand, palm)[0] @ [0.0, 0.0, 1.0] < -0.1


def _vertices(model, data, geom: int) -> np.ndarray:
    """Vertices (P, 3) of a box or a mesh in the world."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        first = model.mesh_vertadr[model.geom_dataid[geom]]
        points = model.mesh_vert[first : first + model.mesh_vertnum[model.geom_dataid[geom]]]
    else:
        assert model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX
        points = model.geom_size[geom] * [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    return points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


@pytest.mark.parametrize("name", ARMS)
def test_closed_fingers_are_as_wide_and_long_as_said(arms, name):
    """Judged by the tips' and pads' geometry once the fingers have closed."""
    env = arms[name]
    env.reset(5)
    command = env.pose()
    command[7] = 1.0
    _settle(env, command, 14)
    model, data = env.world.sim.model._model, env.world.sim.data._data
    tips = [
        geom
        for geom in range(model.ngeom)
        if re.search("finger_?(tip|pad)_(coll|[0-9])", model.geom(geom).name)
    ]
    assert len(tips) == 4
    points = np.concatenate([_vertices(model, data, geom) for geom in tips]) - [0.0, 0.0, 0.8]
    points = apply(invert(env.world.transform_hand_to_workspace()), points)
    measured = [*np.ptp(points[:, :2], axis=0), points[:, 2].max()]
    np.testing.assert_allclose(env.robot.closed_fingers, measured, atol=0.002)


def test_rest_orientation_is_the_documented_one(arms):
    rest = np.array([0.0, 0.0, 0.2, np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0, 0.0])
    right, up, forward = transforms_of_poses(rest)[:3, :3].T
    np.testing.assert_allclose(forward, [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(up, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(right, [0.0, 1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("name", ARMS)
def test_gripper_closes_on_command_and_opens_again(arms, name):
    env = arms[name]
    env.reset(5)
    model, data = env.world.sim.model, env.world.sim.data

    def gap() -> float:
        first, second = (data.geom_xpos[model.geom_name2id(pad)] for pad in PADS[name])
        return float(np.linalg.norm(first - second))

    command = env.pose()
    opened = gap()
    command[7] = 1.0
    _settle(env, command, 14)
    closed = gap()
    command[7] = 0.0
    _settle(env, command, 14)
    assert closed < 0.02
    assert abs(gap() - opened) < 0.015
