"""Push: behind the object, then along the floor with it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.geometry.se3 import apply


def push_poses(take):
    """(M, 4, 4) hand poses from T_start to T_push."""
    return take.trajectory.hand.transforms_hand_to_world[take.trajectory.phases.index("push") - 1 :]


def v_push(take):
    start, goal = take.trajectory.transforms_object_to_world[[0, -1], :3, 3]
    across = np.array([goal[0] - start[0], goal[1] - start[1], 0.0])
    return across / np.linalg.norm(across)


def the_gripper_stays_open_and_half_the_steps_push(take):
    gripper, phases = take.trajectory.hand.gripper, take.trajectory.phases
    np.testing.assert_array_equal(gripper, 0.0)
    approach = round(0.5 * len(gripper))
    assert phases == ("approach",) * approach + ("push",) * (len(gripper) - approach)


def the_hand_is_upright_and_looks_along_the_push(take):
    up = np.array([0.0, 0.0, 1.0])
    expected = np.column_stack([np.cross(up, v_push(take)), up, v_push(take)])
    frames = push_poses(take)[:, :3, :3]
    np.testing.assert_allclose(frames, np.broadcast_to(expected, frames.shape), atol=1e-9)


def the_push_starts_and_ends_behind_the_objects_centre(take):
    centres = take.trajectory.transforms_object_to_world[[0, -1], :3, 3]
    behind = centres - push_poses(take)[[0, -1], :3, 3]
    d = behind[0] @ v_push(take)
    np.testing.assert_allclose(behind, np.broadcast_to(d * v_push(take), (2, 3)), atol=1e-9)
    assert d > 0.0


def a_small_gap_parts_the_cube_from_the_object(take):
    cube = apply(push_poses(take)[0], take.scene.hand.points) @ v_push(take)
    body = take.scene.object.vertices @ v_push(take)
    assert 0.002 - 1e-9 <= body.min() - cube.max() <= 0.01 + 1e-9


def the_push_is_a_straight_level_line_at_even_steps(take):
    steps = np.diff(push_poses(take)[:, :3, 3], axis=0)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-12)
    assert abs(steps[0, 2]) < 1e-12


def the_object_does_not_turn(take):
    turns = take.trajectory.transforms_object_to_world[:, :3, :3]
    np.testing.assert_array_equal(turns, np.broadcast_to(turns[0], turns.shape))


def the_approach_turns_at_a_constant_rate_the_shorter_way(take):
    frames = take.trajectory.hand.transforms_hand_to_world[: take.trajectory.phases.index("push"), :3, :3]
    whole = Rotation.from_matrix(frames[0].T @ frames[-1]).as_rotvec()
    turns = Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]).as_rotvec()
    expected = np.broadcast_to(whole / (len(frames) - 1), turns.shape)
    np.testing.assert_allclose(turns, expected, atol=1e-7)


PUSH = (
    the_gripper_stays_open_and_half_the_steps_push,
    the_hand_is_upright_and_looks_along_the_push,
    the_push_starts_and_ends_behind_the_objects_centre,
    a_small_gap_parts_the_cube_from_the_object,
    the_push_is_a_straight_level_line_at_even_steps,
    the_object_does_not_turn,
    the_approach_turns_at_a_constant_rate_the_shorter_way,
)
