"""Several arms in one world: each one's numbers are its own, and nothing counts them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from task_checks import assert_steps_like_robosuite

from geoprior.errors import DataError, PluginError
from geoprior.geometry.se3 import transforms_of_poses
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.policy import Features
from geoprior.sim.arm import Arm
from geoprior.sim.ensembling import blend
from geoprior.sim.environment import Environment
from geoprior.sim.rollout import CheckpointRef, _require_same_body
from geoprior.sim.setting import Setting
from geoprior.sim.tasks.pick.config import PickConfig
from geoprior.sim.tasks.pick.task import PickTask
from geoprior.sim.tasks.pick.world import PickWorld
from geoprior.sim.trial import _usable
from geoprior.sim.worlds.tabletop import START_REACH

ARMS = {"near": ("ur5e", -0.5), "middle": ("xarm7", 0.0), "far": ("kinova3", 0.5)}


class ThreeArms(PickWorld):
    """A cube that one of three arms could lift."""

    def make_arms(self, robot):
        return [
            Arm(plugins().build("robot", Choice(name=name)), hand, (0.0, y), (-0.07, y, 0.26))
            for hand, (name, y) in ARMS.items()
        ]


@dataclass(frozen=True)
class Waving(PickTask):
    """Every hand waves in a way of its own and closes and opens its gripper."""

    def make(self, robot, setting):
        return ThreeArms(robot, setting, self.config)

    def expert(self, world, start, rng):
        for step in range(30):
            command = start.reshape(-1, 8).copy()
            for hand, pose in enumerate(command):
                phase = 2.0 * np.pi * step / 20.0 + hand
                pose[:3] += 0.04 * np.sin([phase, 1.1 * phase, 1.3 * phase])
                pose[7] = step % 12 < 4 + hand
            yield command.ravel()


@pytest.fixture(scope="module")
def world(cameras):
    setting = Setting(cameras, 10, plugins().build("look", Choice(name="plain")))
    return Environment(plugins().build("robot", Choice(name="ur5e")), Waving(PickConfig()), setting)


def test_the_states_equal_those_of_robosuites_own_loop_to_the_bit(world, monkeypatch):
    monkeypatch.setattr(world, "controller", "exact")
    assert_steps_like_robosuite(world, 3, 12)


def test_the_fast_controller_agrees_with_the_exact_one(world, monkeypatch):
    joints = []
    for controller in ("exact", "fast"):
        monkeypatch.setattr(world, "controller", controller)
        world.reset(3)
        open_hands = np.tile([1, 1, 1, 1, 1, 1, 1, 0], len(ARMS)).astype(np.float32)
        for command in world.expert(0):
            world.step(command * open_hands)
        joints.append(world.world.sim.data.qpos.copy())
    np.testing.assert_allclose(joints[1], joints[0], rtol=0.0, atol=1e-7)
    assert not np.array_equal(joints[1], joints[0]), "one controller ran twice"


def test_every_hand_goes_where_its_own_part_of_a_command_says(world):
    world.reset(0)
    start = world.pose()
    assert start.shape == (8 * len(ARMS),)
    for _ in range(25):
        world.step(start)
    for place, (hand, (_, y)) in enumerate(ARMS.items()):
        command = start.copy()
        command[8 * place : 8 * place + 3] += [0.03, -0.02, 0.04]
        command[8 * place + 7] = 1.0
        for _ in range(25):
            world.step(command)
        wanted, reached = (transforms_of_poses(poses.reshape(-1, 8)) for poses in (command, world.pose()))
        assert np.abs(reached[:, :3, 3] - wanted[:, :3, 3]).max() < 0.015
        np.testing.assert_array_equal(world.pose()[7::8], command[7::8])
        offset = start[8 * place : 8 * place + 3] - [-0.07, y, 0.26]
        assert (np.abs(offset) <= START_REACH + 0.02).all(), "what is left is the controller's error"
        np.testing.assert_allclose(world.world.transform_hand_to_workspace(hand), reached[place], atol=1e-6)


def test_a_hand_starts_by_its_own_name_and_so_apart_from_the_others(world):
    """The draws of one hand do not enter another's."""
    world.reset(5)
    offsets = world.pose().reshape(-1, 8)[:, :3] - [[-0.07, y, 0.26] for _, y in ARMS.values()]
    assert np.abs(np.diff(offsets, axis=0)).max(axis=1).min() > 1e-3


def test_each_hand_has_a_camera_of_its_name_that_rides_on_it(world):
    world.reset(0)
    headers = {header.name: header for header in world.camera_headers()}
    assert list(headers) == sorted([*ARMS, "third"])
    assert {name: header.mount for name, header in headers.items() if name != "third"} == {
        name: name for name in ARMS
    }
    observation = world.observe()
    assert set(observation.images) == set(headers)
    frames = [observation.images[name] for name in ARMS]
    assert not any(np.array_equal(frames[i], frames[i - 1]) for i in range(len(frames)))
    assert world.film_frame(32).shape == (32, 32 * (len(ARMS) + 1), 3)
    data, model = world.world.sim.data, world.world.sim.model
    for name, pose in zip(ARMS, transforms_of_poses(observation.pose.reshape(-1, 8)), strict=True):
        told = (pose @ np.array(headers[name].transform_camera_to_mount))[:3, 3] + [0.0, 0.0, 0.8]
        np.testing.assert_allclose(data.cam_xpos[model.camera_name2id(name)], told, atol=1e-6)


def test_a_policy_of_another_body_is_refused_by_name(world):
    checkpoint = CheckpointRef("prior", 0, 1, Path("epoch.safetensors"))

    @dataclass
    class Told:
        features: Features

    fitting = Features(tuple(sorted([*ARMS, "third"])), (64, 64), tuple(ARMS), 5)
    _require_same_body(checkpoint, Told(fitting), world)
    with pytest.raises(
        DataError, match=r"epoch\.safetensors: .* moves far, middle, near and .* near, middle, far"
    ):
        _require_same_body(checkpoint, Told(replace(fitting, hands=fitting.hands[::-1])), world)
    with pytest.raises(DataError, match=r"looks through hand, third and task 'pick' has far, middle, near"):
        _require_same_body(checkpoint, Told(replace(fitting, cameras=("hand", "third"))), world)


@pytest.mark.parametrize("hands", [("left", "left"), ("left", "third"), ("world",), ()], ids=str)
def test_hands_that_cannot_be_told_apart_are_refused(cameras, hands):
    class World(PickWorld):
        def make_arms(self, robot):
            return [Arm(robot, hand=hand) for hand in hands]

    robot = plugins().build("robot", Choice(name="ur5e"))
    with pytest.raises(PluginError, match=r"World\.make_arms: arms with the hands \["):
        World(robot, Setting(cameras, 10, None), PickConfig())


def test_hands_are_blended_each_for_itself():
    rng = np.random.default_rng(0)
    predictions = rng.normal(size=(5, 24)).astype(np.float32)
    parts = [blend(predictions[:, first : first + 8], 0.1) for first in (0, 8, 16)]
    np.testing.assert_array_equal(blend(predictions, 0.1), np.concatenate(parts))


def test_one_hand_without_a_direction_spoils_a_command():
    command = np.tile([0, 0, 0, 0, 0, 0, 1, 0], 3).astype(np.float32)
    assert _usable(command)
    command[8 + 6] = 0.0
    assert not _usable(command)
