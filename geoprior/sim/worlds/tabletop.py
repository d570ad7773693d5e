"""The world that all tasks share: arms beside a table, cameras, absolute control of the hands."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.episode import WORLD, can_be_told_apart
from geoprior.errors import PluginError
from geoprior.geometry.se3 import (
    REFERENCE_QUATERNION,
    TRANSFORM_CAMERA_TO_HAND_AXES,
    look_at,
    make_transform,
)
from geoprior.geometry.seeding import generator
from geoprior.scene.hand import HAND
from geoprior.sim.arm import Arm
from geoprior.sim.backend import prepare_robosuite
from geoprior.sim.kinematics import solve_joints

prepare_robosuite()

from robosuite.environments.manipulation.manipulation_env import ManipulationEnv  # noqa: E402
from robosuite.models.arenas import TableArena  # noqa: E402
from robosuite.models.tasks import ManipulationTask  # noqa: E402

if TYPE_CHECKING:
    from geoprior.geometry.se3 import FloatArray
    from geoprior.sim.robots.robot import Robot
    from geoprior.sim.setting import Setting

TABLE_SIZE = (0.8, 0.8, 0.05)
TABLE_TOP = np.array([0.0, 0.0, 0.8])
"""Origin of the workspace frame in robosuite's world frame; the axes are parallel."""

THIRD_CAMERA_POSITION = np.array([0.42, 0.25, 0.49])
THIRD_CAMERA_TARGET = np.array([0.0, 0.01, 0.12])

START_POSITION = np.array(Arm.start)
START_REACH = np.array([0.03, 0.03, 0.025])
START_YAW = np.radians(10.0)
"""An episode begins with open hands that point straight down, each one's position drawn evenly within +-
reach about its arm's start (metres, workspace frame) and its up axis within +- yaw of the workspace's +x."""

_MUJOCO_CAMERA_AXES = np.diag([1.0, -1.0, -1.0])
"""MuJoCo's cameras look along -z with +y up; ours along +z with +y down."""

_HAND_DOWN = Rotation.from_quat(REFERENCE_QUATERNION)

HAND_CAMERA = HAND
THIRD_CAMERA = "third"

TABLE_COLOUR = (0.66, 0.65, 0.62, 1.0)
FLOOR_COLOUR = (0.34, 0.37, 0.41, 1.0)
COLLISION_GROUP = 0

REST_SPEED = 0.02
REST_TURNING = 0.3
"""Metres and radians a second: what moves more slowly is at rest."""


class Tabletop(ManipulationEnv):  # type: ignore[misc]  # robosuite has no types
    """Arms at a table; a task's world adds objects and says how they are placed and judged.

    It is a robosuite environment like any other: it can be stepped by robosuite's own loop. Placing,
    judging and drawing are ours.

    Args:
        robot: The arm; see `make_arms`.
        setting: How it is seen and paced.

    Raises:
        PluginError: Two of its arms have hands of one name, or one is named like the third camera.

    Attributes:
        third_camera: (3,) where the third camera stands and (3,) what it looks at, workspace frame, metres.
    """

    third_camera = (THIRD_CAMERA_POSITION, THIRD_CAMERA_TARGET)

    def __init__(self, robot: Robot, setting: Setting) -> None:
        self.robot = robot
        self.arms = self._by_hand(self.make_arms(robot))
        self.state_seed = 0
        self._cameras, self._look = setting.cameras, setting.look
        super().__init__(
            robots=[arm.robot.robosuite_name for arm in self.arms.values()],
            controller_configs=[_absolute_pose_control() for _ in self.arms],
            gripper_types=[arm.robot.gripper for arm in self.arms.values()],
            initialization_noise=None,
            use_camera_obs=False,
            has_offscreen_renderer=False,
            renderer="mujoco",
            control_freq=setting.control_rate,
            ignore_done=True,
            hard_reset=False,
            seed=0,
        )

    # What a task's world fills in -----------------------------------------------------------------

    def make_arms(self, robot: Robot) -> Sequence[Arm]:
        """The arms, in pose order; called before anything else is built.

        A world with more than the one arm in its usual place says here which ones and where.
        """
        return [Arm(robot)]

    def make_objects(self) -> Sequence[Any]:
        """The robosuite objects on the table."""
        raise NotImplementedError

    def place_objects(self, rng: np.random.Generator) -> None:
        """Draw where the objects start and write it to ``sim.data.qpos``."""
        raise NotImplementedError

    def succeeded(self) -> bool:
        """Whether the goal is reached in this very state."""
        raise NotImplementedError

    def failure(self) -> str:
        """Why the goal can no longer be reached, or an empty string."""
        return ""

    def aim_points(self) -> Mapping[str, FloatArray]:
        """Where a policy's hand should go, by name: (3,) each, workspace frame, metres.

        ``object`` is what the hand has to reach first, ``contact`` where it has to be to push it; a task may
        have no such point. `geoprior probe` compares predicted chunks with them.
        """
        return {}

    # Frames -----------------------------------------------------------------------------------------

    def _by_hand(self, arms: Sequence[Arm]) -> dict[str, Arm]:
        hands = [arm.hand for arm in arms]
        if not can_be_told_apart(hands, THIRD_CAMERA):
            raise PluginError(
                f"{type(self).__name__}.make_arms: arms with the hands {hands}",
                f"give at least one arm, and name each hand once and none {THIRD_CAMERA!r} or {WORLD!r}",
            )
        return {arm.hand: arm for arm in arms}

    @property
    def hands(self) -> tuple[str, ...]:
        """Names of the arms' hands, in pose order."""
        return tuple(self.arms)

    def transform_hand_to_workspace(self, hand: str = HAND) -> FloatArray:
        """(4, 4) of a hand's frame now; see `geoprior.sim.robots.robot.Robot`."""
        data = self.sim.data
        site = self.robots[self.hands.index(hand)].eef_site_id["right"]
        rotation = data.site_xmat[site].reshape(3, 3) @ np.array(self.arms[hand].robot.rotation_hand_to_site)
        return make_transform(rotation, data.site_xpos[site] - TABLE_TOP)

    def transform_camera_to_hand(self, hand: str = HAND) -> FloatArray:
        """(4, 4) of a hand's camera in the hand frame."""
        robot = self.arms[hand].robot
        # A positive pitch turns the line of sight from forward towards minus up: to the finger tips of a
        # camera that sits on the up side.
        pitch = Rotation.from_euler("x", robot.camera_pitch).as_matrix()
        return make_transform(pitch @ TRANSFORM_CAMERA_TO_HAND_AXES, np.array(robot.camera_position))

    def transform_camera_to_workspace(self) -> FloatArray:
        """(4, 4) of the third camera in the workspace frame, where the look has put it."""
        model = self.sim.model._model
        camera = model.camera(THIRD_CAMERA).id
        w, x, y, z = model.cam_quat[camera]
        rotation = Rotation.from_quat([x, y, z, w]).as_matrix() @ _MUJOCO_CAMERA_AXES
        return make_transform(rotation, model.cam_pos[camera] - TABLE_TOP)

    # Objects ----------------------------------------------------------------------------------------

    def transform_object_to_workspace(self, thing: Any) -> FloatArray:
        """(4, 4) of one of the robosuite objects on the table."""
        data = self.sim.data
        rotation = np.array(data.get_body_xmat(thing.root_body)).reshape(3, 3)
        return make_transform(rotation, np.array(data.get_body_xpos(thing.root_body)) - TABLE_TOP)

    def object_at_rest(self, thing: Any) -> bool:
        """Whether an object with a free joint moves and turns no faster than `REST_SPEED`, `REST_TURNING`."""
        velocity = np.array(self.sim.data.get_joint_qvel(thing.joints[0]))
        speed, turning = np.linalg.norm(velocity[:3]), np.linalg.norm(velocity[3:])
        return bool(speed < REST_SPEED and turning < REST_TURNING)

    def object_in_hand(self, thing: Any) -> bool:
        """Whether any part of a gripper touches an object."""
        return any(self.check_contact(thing, robot.gripper["right"]) for robot in self.robots)

    # robosuite's hooks ------------------------------------------------------------------------------

    def reward(self, action: Any = None) -> float:  # noqa: ARG002
        """None: demonstrations teach, not rewards."""
        return 0.0

    def _check_success(self) -> bool:
        return self.succeeded()

    def _load_model(self) -> None:
        super()._load_model()
        models = [robot.robot_model for robot in self.robots]
        for model, arm in zip(models, self.arms.values(), strict=True):
            usual = np.array(model.base_xpos_offset["table"](TABLE_SIZE[0]))
            model.set_base_xpos(usual + np.array([*arm.base, 0.0]))
        arena = TableArena(table_full_size=TABLE_SIZE, table_offset=TABLE_TOP)
        arena.set_origin([0.0, 0.0, 0.0])
        _paint(arena)
        self._add_cameras(arena)
        self.objects = list(self.make_objects())
        self.model = ManipulationTask(mujoco_arena=arena, mujoco_robots=models, mujoco_objects=self.objects)
        self._look.furnish(self.model.root)

    def _initialize_sim(self, xml_string: str | None = None) -> None:
        super()._initialize_sim(xml_string)
        _collide_at_single_points(self.sim.model)
        _light(self.sim.model)

    def _setup_observables(self) -> dict[str, Any]:
        """None: the wrapper reads what it needs, when somebody looks."""
        return {}

    def _reset_internal(self) -> None:
        for robot, arm in zip(self.robots, self.arms.values(), strict=True):
            robot.init_qpos = self._start_joints(robot, arm)
        super()._reset_internal()
        self.place_objects(generator(self.state_seed, "state", "objects"))
        for robot in self.robots:
            gripper = robot.gripper["right"]
            # robosuite starts half closed and opens during the first half second.
            gripper.current_action = -np.ones_like(gripper.init_qpos[:1])

    def _start_joints(self, robot: Any, arm: Arm) -> FloatArray:
        """Joint angles of a hand's start pose, drawn around its arm's start."""
        rng = generator(self.state_seed, "state", arm.hand)
        position = np.array(arm.start) + rng.uniform(-START_REACH, START_REACH)
        rotation = Rotation.from_euler("z", rng.uniform(-START_YAW, START_YAW)) * _HAND_DOWN
        to_site = np.array(arm.robot.rotation_hand_to_site).T
        model, data = self.sim.model._model, self.sim.data._data
        return solve_joints(
            model,
            data,
            model.site(robot.gripper["right"].important_sites["grip_site"]).id,
            [model.joint(name).id for name in robot.robot_model.joints],
            make_transform(rotation.as_matrix() @ to_site, position + TABLE_TOP),
            np.array(arm.robot.home_joints),
        )

    def _add_cameras(self, arena: TableArena) -> None:
        third = look_at(*self.third_camera, np.array([0.0, 0.0, 1.0]))
        third[:3, 3] += TABLE_TOP
        arena.worldbody.append(_camera(THIRD_CAMERA, third, self._cameras.third.vertical_fov))
        for robot, arm in zip(self.robots, self.arms.values(), strict=True):
            self._add_hand_camera(robot.gripper["right"], arm)

    def _add_hand_camera(self, gripper: Any, arm: Arm) -> None:
        name = gripper.important_sites["grip_site"]
        body = next(body for body in gripper.worldbody.iter("body") if _site(body, name) is not None)
        transform_site_to_body = _transform_of(_site(body, name))
        transform_hand_to_site = make_transform(np.array(arm.robot.rotation_hand_to_site), np.zeros(3))
        to_body = transform_site_to_body @ transform_hand_to_site @ self.transform_camera_to_hand(arm.hand)
        body.append(_camera(arm.hand, to_body, self._cameras.hand.vertical_fov))


def _absolute_pose_control() -> dict[str, Any]:
    """Operational-space control with robosuite's default gains, fed with absolute world poses."""
    arm = {
        "type": "OSC_POSE",
        "input_max": 1,
        "input_min": -1,
        "output_max": [0.05, 0.05, 0.05, 0.5, 0.5, 0.5],
        "output_min": [-0.05, -0.05, -0.05, -0.5, -0.5, -0.5],
        "kp": 150,
        "damping_ratio": 1,
        "impedance_mode": "fixed",
        "kp_limits": [0, 300],
        "damping_ratio_limits": [0, 10],
        "position_limits": None,
        "orientation_limits": None,
        "uncouple_pos_ori": True,
        "input_type": "absolute",
        "input_ref_frame": "world",
        "interpolation": None,
        "ramp_ratio": 0.2,
        "gripper": {"type": "GRIP"},
    }
    return {"type": "BASIC", "body_parts": {"right": arm}}


def _paint(arena: TableArena) -> None:
    """Plain colours instead of textures, no walls and no legs: cheaper to draw, and calm behind the objects.

    robosuite's floor is a plane, which OpenGL draws as thousands of squares; a flat box stands in for it in
    the pictures, and nothing collides with that.
    """
    for parent in (arena.worldbody, arena.table_body):
        for geom in parent.findall("./geom"):
            if geom.get("name").startswith(("wall", "table_leg")):
                parent.remove(geom)
    _colour(arena.table_visual, TABLE_COLOUR)
    arena.floor.set("group", str(COLLISION_GROUP))
    picture = {"name": "floor_visual", "type": "box", "pos": "0 0 -0.01", "size": "15 15 0.01", "group": "1"}
    floor = ET.Element("geom", {**picture, "contype": "0", "conaffinity": "0"})
    _colour(floor, FLOOR_COLOUR)
    arena.worldbody.append(floor)


def _colour(geom: ET.Element, colour: tuple[float, ...]) -> None:
    geom.attrib.pop("material", None)
    geom.set("rgba", " ".join(map(str, colour)))


def _collide_at_single_points(model: Any) -> None:
    """One contact point for a pair of meshes, which was MuJoCo's default when robosuite was made.

    MuJoCo 3.8 finds several by default. The Robotiq's linkage, which robosuite holds together by contacts
    alone, then jams at 61 mm and cannot grip anything narrower.
    """
    several = getattr(mujoco.mjtDisableBit, "mjDSBL_MULTICCD", None)
    if several is not None:
        model.opt.disableflags |= int(several)


def _light(model: Any) -> None:
    """Soft light from the camera and one lamp from the front left: the sides of a box differ in shade."""
    model.vis.headlight.ambient[:] = 0.35
    model.vis.headlight.diffuse[:] = 0.25
    model.vis.headlight.specular[:] = 0.0
    model.light_diffuse[:] = 0.55
    model.light_specular[:] = 0.1
    model.light_dir[:] = np.array([-0.45, -0.25, -0.857])


def _site(body: ET.Element, name: str) -> ET.Element | None:
    return body.find(f"./site[@name='{name}']")


def _camera(name: str, transform_camera_to_parent: FloatArray, vertical_fov: float) -> ET.Element:
    rotation = transform_camera_to_parent[:3, :3] @ _MUJOCO_CAMERA_AXES
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    numbers: dict[str, FloatArray] = {
        "pos": transform_camera_to_parent[:3, 3],
        "quat": np.array([w, x, y, z]),
        "fovy": np.array([vertical_fov]),
    }
    attributes = {key: " ".join(repr(float(number)) for number in value) for key, value in numbers.items()}
    return ET.Element("camera", {"name": name, "mode": "fixed", **attributes})


def _transform_of(element: ET.Element | None) -> FloatArray:
    assert element is not None
    position = np.array([float(number) for number in element.get("pos", "0 0 0").split()])
    w, x, y, z = (float(number) for number in element.get("quat", "1 0 0 0").split())
    return make_transform(Rotation.from_quat([x, y, z, w]).as_matrix(), position)
