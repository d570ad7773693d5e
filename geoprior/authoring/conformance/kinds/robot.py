"""A robot: the same numbers put its fingers where they would put any other's."""

from __future__ import annotations

import numpy as np

from geoprior.authoring.conformance.check import Check, refuse, require
from geoprior.authoring.conformance.common import require_own_name
from geoprior.authoring.conformance.stage import demonstrate, world_with
from geoprior.episode import POSE_SIZE
from geoprior.errors import DataError
from geoprior.geometry.se3 import apply, invert, transforms_of_poses
from geoprior.hooks.types import RobotSpec

SEEDS = range(4)
NEAR = 0.012
"""Metres by which the controller, which has no integral part, may stay away from a command."""
TURNED = 0.06
"""The same for the numbers of a rotation matrix."""
SECONDS = 2.5


def numbers_are_those_of_an_arm(spec: RobotSpec) -> None:
    """Its name is the spec's, its joints are finite, its hand frame is a right-handed rotation."""
    robot, where = spec.factory(spec.config()), f"robot {spec.name!r}"
    require_own_name(spec, robot.name)
    require(
        np.isfinite(robot.home_joints).all(), f"{where}: a home joint is not finite", "joints are radians"
    )
    rotation = np.array(robot.rotation_hand_to_site)
    require(
        rotation.shape == (3, 3)
        and np.allclose(rotation.T @ rotation, np.eye(3), atol=1e-9)
        and np.linalg.det(rotation) > 0.0,
        f"{where}: rotation_hand_to_site is no right-handed rotation: {rotation.tolist()}",
        "its columns are right, up and forward in the frame of robosuite's grip site",
    )


def begins_where_all_arms_begin(spec: RobotSpec) -> None:
    """The start pose of a seed is that of the other arms: hands above the table, pointing down."""
    env, other = world_with(spec), world_with()
    for seed in SEEDS:
        env.reset(seed)
        other.reset(seed)
        mine, theirs = env.pose(), other.pose()
        if len(mine) == len(theirs):
            require(
                np.abs(mine - theirs).max() < 1e-3,
                f"robot {spec.name!r}, seed {seed}: begins at {mine.round(3).tolist()}, "
                f"other arms at {theirs.round(3).tolist()}",
                "choose home_joints with the hand over the middle of the table, pointing down",
            )


def goes_where_it_is_sent(spec: RobotSpec) -> None:
    """Sent to poses near the start, every hand gets there."""
    env = world_with(spec)
    for seed in SEEDS:
        env.reset(seed)
        command = env.pose()
        command.reshape(-1, POSE_SIZE)[:, :3] += np.array([0.06, -0.05, -0.08], dtype=np.float32)
        for _ in range(round(SECONDS * env.control_rate)):
            env.step(command)
        wanted = transforms_of_poses(command.reshape(-1, POSE_SIZE))
        reached = transforms_of_poses(env.pose().reshape(-1, POSE_SIZE))
        missed = np.abs(reached[..., :3, 3] - wanted[..., :3, 3]).max()
        turned = np.abs(reached[..., :3, :3] - wanted[..., :3, :3]).max()
        require(
            missed < NEAR and turned < TURNED,
            f"robot {spec.name!r}, seed {seed}: {missed:.3f} m and {turned:.3f} (rotation) off its command",
            "check rotation_hand_to_site, and home_joints: the arm may be near a joint's limit",
        )


def fingers_close_along_right(spec: RobotSpec) -> None:
    """When the gripper closes, its parts move along the hand's right axis and not along up."""
    env = world_with(spec)
    env.reset(0)
    before = _gripper_in_hand_frame(spec)
    command = env.pose()
    command.reshape(-1, POSE_SIZE)[:, 7] = 1.0
    for _ in range(round(SECONDS * env.control_rate)):
        env.step(command)
    moved = np.abs(_gripper_in_hand_frame(spec) - before).max(axis=0)
    across = moved[:2].max()
    require(across > 0.005, f"robot {spec.name!r}: its fingers move by {across:.4f} m when they close")
    require(
        moved[0] > 3.0 * moved[1],
        f"robot {spec.name!r}: closes by {moved[0]:.3f} m along right and {moved[1]:.3f} m along up",
        "turn rotation_hand_to_site by a quarter about forward",
    )


def demonstrates_a_task(spec: RobotSpec) -> None:
    """The scripted expert of `pick` succeeds from one of a few initial states at least."""
    from geoprior.sim.environment import UnstablePhysicsError

    env, reasons = world_with(spec), []
    for seed in SEEDS:
        env.reset(seed)
        try:
            verdict = demonstrate(env)
        except (UnstablePhysicsError, DataError) as error:
            verdict = str(error)
        if verdict == "":
            return
        reasons.append(verdict or "not lifted")
    refuse(f"robot {spec.name!r}: no demonstration of pick succeeds: {', '.join(reasons)}")


def _gripper_in_hand_frame(spec: RobotSpec) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """(G, 3) middles of the gripper's geometries, seen from the hand; metres."""
    from geoprior.sim.worlds.tabletop import TABLE_TOP

    env = world_with(spec)
    model, data = env.world.sim.model._model, env.world.sim.data._data
    geoms = [
        geom for geom in range(model.ngeom) if model.body(model.geom_bodyid[geom]).name.startswith("gripper")
    ]
    to_hand = invert(env.world.transform_hand_to_workspace(env.hands[0]))
    return apply(to_hand, data.geom_xpos[geoms] - TABLE_TOP)


CHECKS = (
    Check("its numbers are those of an arm", numbers_are_those_of_an_arm),
    Check("it begins where all arms begin", begins_where_all_arms_begin, slow=True),
    Check("it goes where it is sent", goes_where_it_is_sent, slow=True),
    Check("its fingers close along right", fingers_close_along_right, slow=True),
    Check("it demonstrates a task", demonstrates_a_task, slow=True),
)
