"""The fast controller against the exact one, which `test_control` holds to robosuite's own."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from itertools import islice
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geoprior.errors import ConfigError
from geoprior.geometry.se3 import continuous_quaternions
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.sim._osc_kernel import _solve
from geoprior.sim.control import LAWS
from geoprior.sim.demos import AttemptTask, record_expert
from geoprior.sim.environment import Environment, UnstablePhysicsError
from geoprior.sim.osc_fast import _require_hinges
from geoprior.sim.robosuite_arm import RobosuiteArm
from geoprior.sim.workers import Setup, environment

ARMS = ("ur5e", "xarm7", "kinova3")
STATE = ("qpos", "qvel", "qacc_warmstart", "ctrl", "time")


@pytest.fixture
def fast(env, monkeypatch):
    """The session's environment with the fast controller from its next reset on."""
    monkeypatch.setattr(env, "controller", "fast")
    return env


def _waving(start: np.ndarray, steps: int) -> list[np.ndarray]:
    """Commands that move and turn about all axes, high over the table.

    The gripper begins to close and opens again: a Robotiq's fingers that meet are thrown about by contacts,
    and rounding grows within a few steps.
    """
    commands, quaternion = [], start[3:7].astype(np.float64)
    for step in range(steps):
        phase = 2.0 * np.pi * step / 25.0
        place = start[:3] + np.sin([phase, 0.7 * phase, 1.3 * phase]) * [0.08, 0.10, 0.06]
        turn = Rotation.from_rotvec(np.sin([phase, 0.8 * phase, 0.6 * phase]) * [0.3, 0.25, 0.5])
        rotation = turn * Rotation.from_quat(start[3:7])
        quaternion = continuous_quaternions(rotation.as_quat()[None], quaternion)[0]
        commands.append(np.array([*place, *quaternion, step % 12 < 4], dtype=np.float32))
    return commands


def _states(env, commands) -> np.ndarray:
    states = []
    for command in commands:
        env.step(command)
        data = env.world.sim.data
        states.append(np.concatenate([np.ravel(getattr(data, name)) for name in STATE]))
        assert not _touching(env)
    return np.array(states)


def _touching(env) -> list[tuple[str, str]]:
    """Contacts of the arm or the gripper with anything else."""
    model, data = env.world.sim.model, env.world.sim.data
    names = [
        tuple(
            model.body_id2name(model.geom_bodyid[geom]) or ""
            for geom in (data.contact[contact].geom1, data.contact[contact].geom2)
        )
        for contact in range(data.ncon)
    ]
    return [pair for pair in names if sum(name.startswith(("robot0", "gripper0")) for name in pair) == 1]


@pytest.mark.parametrize("arm", ARMS)
def test_joints_agree_with_the_exact_controller(arm, pick, cameras, monkeypatch):
    """Over 50 commands free of contact; 1e-6 rad is wanted, and rounding is far below it."""
    env = environment(Setup(Choice(name=arm), pick, cameras), 10)
    monkeypatch.setattr(env, "controller", "exact")
    env.reset(3)
    commands = _waving(env.pose(), 50)
    exact = _states(env, commands)
    monkeypatch.setattr(env, "controller", "fast")
    env.reset(3)
    fast = _states(env, commands)
    joints = env.world.sim.model.nq
    assert np.ptp(exact[:, :joints], axis=0).max() > 0.3, "the arm has hardly moved"
    np.testing.assert_allclose(fast[:, :joints], exact[:, :joints], rtol=0.0, atol=1e-9)
    assert not np.array_equal(fast, exact), "the exact controller ran twice"


def test_an_episode_is_the_same_to_the_bit_after_others_and_in_a_fresh_environment(fast):
    fast.reset(7)
    commands = _waving(fast.pose(), 12)
    first = _states(fast, commands)
    fast.reset(8)
    for command in islice(fast.expert(seed=0), 20):
        fast.step(command)
    fast.reset(7)
    np.testing.assert_array_equal(_states(fast, commands), first)
    fresh = Environment(fast.robot, fast.task, fast.setting)
    fresh.reset(7)
    np.testing.assert_array_equal(_states(fresh, commands), first)
    fresh.close()


def _outcome(env, number: int) -> tuple[str, int]:
    setup = Setup(Choice(name=env.robot.name), Choice(name="pick"), env.cameras)
    task = AttemptTask(number, number, setup, 10, 0, Path("unused"))
    _, reason, steps = record_expert(env, task)
    return reason, steps


def test_experts_fare_the_same(env, monkeypatch):
    monkeypatch.setattr(env, "controller", "exact")
    exact = [_outcome(env, number) for number in range(2)]
    monkeypatch.setattr(env, "controller", "fast")
    assert [_outcome(env, number) for number in range(2)] == exact


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_experts_fare_the_same_on_20_states(arm, pick, cameras, monkeypatch):
    env = environment(Setup(Choice(name=arm), pick, cameras), 10)
    monkeypatch.setattr(env, "controller", "exact")
    exact = [_outcome(env, number) for number in range(20)]
    monkeypatch.setattr(env, "controller", "fast")
    assert [_outcome(env, number) for number in range(20)] == exact


@pytest.mark.slow
def test_an_episode_is_the_same_to_the_bit_in_another_process(fast, run_python):
    code = (
        "import hashlib\n"
        "from itertools import islice\n"
        "from geoprior.geometry.camera import CamerasConfig\n"
        "from geoprior.options import Choice\n"
        "from geoprior.sim.workers import Setup, environment\n"
        "cameras = CamerasConfig(height=64, width=64)\n"
        "env = environment(Setup(Choice(name='ur5e'), Choice(name='pick'), cameras), 10)\n"
        "env.reset(5)\n"
        "for command in islice(env.expert(seed=0), 40): env.step(command)\n"
        "print(hashlib.sha256(env.world.sim.data.qpos.tobytes()).hexdigest())\n"
    )
    fast.reset(5)
    for command in islice(fast.expert(seed=0), 40):
        fast.step(command)
    wanted = hashlib.sha256(fast.world.sim.data.qpos.tobytes()).hexdigest()
    assert run_python(code).strip() == wanted


def _both_torques(env, position: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What both laws command in the state that the environment is in."""
    arm = RobosuiteArm.of(env.world, env.world.robots[0])
    mujoco.mj_step1(arm.model, arm.data)
    torques = []
    for name in ("exact", "fast"):
        arm.data.ctrl[:] = np.nan
        LAWS[name](arm).command(position, rotation)
        torques.append(arm.data.ctrl[arm.actuators].copy())
    return torques[0], torques[1]


@pytest.mark.parametrize("far", [np.array([30.0, -20.0, 10.0]), np.array([-30.0, 20.0, 0.5])])
def test_torques_stay_within_the_motors_limits(env, far):
    env.reset(1)
    exact, fast = _both_torques(env, far, np.eye(3))
    arm = RobosuiteArm.of(env.world, env.world.robots[0])
    assert (fast >= arm.low).all()
    assert (fast <= arm.high).all()
    assert ((fast == arm.low) | (fast == arm.high)).sum() >= 3
    np.testing.assert_allclose(fast, exact, atol=1e-8)


@pytest.mark.parametrize(
    "joints",
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],  # stretched out, the wrist in line with the forearm
        [0.3, -1.2, 0.0, -0.4, -1.59, 0.0],  # the elbow straight
        [-0.47, -1.735, 2.48, -2.275, 0.0, 0.3],  # two axes of the wrist in line
    ],
)
def test_a_singular_posture_is_treated_as_robosuite_treats_it(env, joints):
    """Of the hand's mobility only the block of position and that of rotation are inverted for its torques.

    The whole is inverted for the pull to the rest posture, which six joints leave no room for: where it is
    singular, what comes of that pull is damped by the pseudo-inverse alike.
    """
    env.reset(1)
    arm = RobosuiteArm.of(env.world, env.world.robots[0])
    arm.data.qpos[arm.controller.qpos_index] = joints
    mujoco.mj_forward(arm.model, arm.data)
    site = arm.data.site_xpos[arm.hand_site]
    exact, fast = _both_torques(env, site + np.array([0.02, -0.03, 0.01]), np.eye(3))
    np.testing.assert_allclose(fast, exact, rtol=1e-5, atol=1e-5)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 3), st.floats(-14.0, 0.0))
def test_solving_falls_back_on_the_pseudo_inverse(seed, nullity, magnitude):
    """Right sides lie in the range of the matrix, as forces on the hand do that some joint can feel."""
    rng = np.random.default_rng(seed)
    basis, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    values = rng.uniform(0.1, 1.0, 6)
    values[:nullity] = 0.0
    matrix = 10.0**magnitude * (basis * values) @ basis.T
    matrix = 0.5 * (matrix + matrix.T)
    wanted = basis[:, nullity:] @ rng.normal(size=6 - nullity)
    np.testing.assert_allclose(_solve(matrix, matrix @ wanted), wanted, rtol=1e-6, atol=1e-6)


def test_no_torques_come_of_an_inertia_that_is_not_positive_definite(fast):
    fast.reset(1)
    arm = RobosuiteArm.of(fast.world, fast.world.robots[0])
    law = LAWS["fast"](arm)
    arm.data.qM[:] = 0.0
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        law.command(np.zeros(3), np.eye(3))


@pytest.mark.parametrize("fault", [np.nan, 1e12])
def test_broken_physics_is_reported_and_survived(fast, fault):
    fast.reset(1)
    command = fast.pose()
    fast.world.sim.data.qvel[0] = fault
    with pytest.raises(UnstablePhysicsError):
        fast.step(command)
    fast.reset(7)
    states = _states(fast, _waving(fast.pose(), 3))
    fast.reset(7)
    np.testing.assert_array_equal(_states(fast, _waving(fast.pose(), 3)), states)


def test_a_goal_that_is_not_a_number_is_unstable_physics(fast):
    fast.reset(1)
    command = fast.pose()
    fast.step(command)
    command[0] = np.nan
    with pytest.raises(UnstablePhysicsError, match="not finite"):
        fast.step(command)


def test_a_hand_that_other_joints_move_is_refused():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint type='slide'/><geom size='.1'/><body><joint/><geom size='.1'/>"
        "<site name='hand'/></body></body></worldbody></mujoco>"
    )
    for joints in ([1], [0, 1]):
        with pytest.raises(ConfigError, match="'fast'") as caught:
            _require_hinges(model, np.array(joints), 0)
        assert "exact" in caught.value.hint


def test_an_unknown_controller_shows_the_choices(env):
    with pytest.raises(ConfigError, match="'quick'") as caught:
        Environment(replace(env.robot, controller="quick"), env.task, env.setting)
    assert "exact or fast" in caught.value.hint


@pytest.mark.parametrize("name", LAWS)
def test_the_robots_option_decides(name):
    arm = plugins().build("robot", Choice(name="ur5e", options={"controller": name}))
    assert arm.controller == name
