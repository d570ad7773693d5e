"""Every step of every motion."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.geometry.se3 import apply, invert, pose_vectors
from laws.solids import depth_of_the_hand_in_the_object

STRAIGHT_DOWN = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
"""x, y, z, w of a hand that points straight down with its up axis along +x."""


def contact(take):
    """The step from which hand and object are one: the grasp, or the start of the push."""
    phases = take.trajectory.phases
    return phases.index("push") - 1 if "push" in phases else phases.index("grasp")


def hand_frames_are_right_handed_rotations(take):
    frames = take.trajectory.hand.transforms_hand_to_world[:, :3, :3]
    identity = np.broadcast_to(np.eye(3), frames.shape)
    np.testing.assert_allclose(np.swapaxes(frames, 1, 2) @ frames, identity, atol=1e-9)
    right, up, forward = np.moveaxis(frames, 2, 0)
    np.testing.assert_allclose(np.cross(up, forward), right, atol=1e-9)


def poses_hold_continuous_unit_quaternions_from_the_reference_on(take):
    trajectory = take.trajectory
    frames = trajectory.hand.transforms_hand_to_world
    poses = pose_vectors(frames, trajectory.hand.gripper).astype(np.float64)
    quaternions = poses[:, 3:7]
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-6)
    assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.98)
    assert quaternions[0] @ STRAIGHT_DOWN > 0.3, "clear of the edge where the sign would be a toss"
    np.testing.assert_allclose(Rotation.from_quat(quaternions).as_matrix(), frames[:, :3, :3], atol=1e-6)
    np.testing.assert_allclose(poses[:, :3], frames[:, :3, 3], atol=1e-7)
    np.testing.assert_array_equal(poses[:, 7], trajectory.hand.gripper)


def it_starts_from_the_scene(take):
    trajectory, scene = take.trajectory, take.scene
    start = trajectory.hand.transforms_hand_to_world[0]
    np.testing.assert_allclose(start, scene.hand.transform_hand_to_world, atol=1e-12)
    start = trajectory.transforms_object_to_world[0]
    np.testing.assert_array_equal(start, scene.object.transform_object_to_world)


def every_step_has_all_its_parts(take):
    trajectory = take.trajectory
    steps = len(trajectory.hand.gripper)
    assert len(trajectory.phases) == steps
    for transforms in (trajectory.hand.transforms_hand_to_world, trajectory.transforms_object_to_world):
        assert transforms.shape == (steps, 4, 4)
        np.testing.assert_array_equal(transforms[:, 3], np.broadcast_to([0.0, 0.0, 0.0, 1.0], (steps, 4)))


def the_object_never_sinks_below_the_floor_nor_tilts(take):
    transforms = take.trajectory.transforms_object_to_world
    lowest = apply(transforms, take.scene.object.mesh.vertices[None])[..., 2].min()
    assert lowest >= take.scene.floor.height - 1e-9
    np.testing.assert_allclose(transforms[:, 2, 2], 1.0, atol=1e-9)


def the_hands_origin_stays_above_the_floor(take):
    assert take.trajectory.hand.transforms_hand_to_world[:, 2, 3].min() > take.scene.floor.height


def the_object_waits_and_then_moves_with_the_hand(take):
    trajectory, first = take.trajectory, contact(take)
    waiting = trajectory.transforms_object_to_world[: first + 1]
    np.testing.assert_array_equal(waiting, np.broadcast_to(waiting[0], waiting.shape))
    relative = invert(trajectory.hand.transforms_hand_to_world) @ trajectory.transforms_object_to_world
    held = relative[first:]
    np.testing.assert_allclose(held, np.broadcast_to(held[0], held.shape), rtol=0.0, atol=1e-6)


def the_approach_is_a_straight_line_at_even_steps(take):
    way = take.trajectory.hand.transforms_hand_to_world[: contact(take) + 1, :3, 3]
    times = np.linspace(0.0, 1.0, len(way))[:, None]
    np.testing.assert_allclose(way, (1.0 - times) * way[0] + times * way[-1], atol=1e-12)


def the_hand_is_outside_the_object_from_contact_on(take):
    """Before that, the straight approach of a push may lead through the object, as the paper has it."""
    trajectory, scene = take.trajectory, take.scene
    relative = invert(trajectory.transforms_object_to_world) @ trajectory.hand.transforms_hand_to_world
    held = relative[contact(take) :]
    assert depth_of_the_hand_in_the_object(scene.object.mesh, scene.hand.cube, held).max() <= 1e-9


ALWAYS = (
    hand_frames_are_right_handed_rotations,
    poses_hold_continuous_unit_quaternions_from_the_reference_on,
    it_starts_from_the_scene,
    every_step_has_all_its_parts,
    the_object_never_sinks_below_the_floor_nor_tilts,
    the_hands_origin_stays_above_the_floor,
    the_object_waits_and_then_moves_with_the_hand,
    the_approach_is_a_straight_line_at_even_steps,
    the_hand_is_outside_the_object_from_contact_on,
)
