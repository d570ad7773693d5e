"""Every law refuses an episode that breaks it: a law that cannot fail proves nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from laws import LAWS, always, grasping, marker, pushing, start
from scipy.spatial.transform import Rotation

from geoprior.motions.trajectory import way_of_hand

TINY = 2e-6
"""Metres: just more than any law lets pass."""


def hand(take, steps, change):
    """The take with other hand poses; ``change`` is given a copy of those at ``steps``."""
    frames = take.trajectory.hand.transforms_hand_to_world.copy()
    frames[steps] = change(frames[steps].copy())
    return trajectory(take, hands=way_of_hand(frames, take.trajectory.hand.gripper))


def solid(take, steps, change):
    """The same for the object's poses."""
    poses = take.trajectory.transforms_object_to_world.copy()
    poses[steps] = change(poses[steps].copy())
    return replace(take, trajectory=replace(take.trajectory, transforms_object_to_world=poses))


def trajectory(take, **changes):
    return replace(take, trajectory=replace(take.trajectory, **changes))


def gripper(take, step, value):
    values = take.trajectory.hand.gripper.copy()
    values[step] = value
    return trajectory(take, hands=way_of_hand(take.trajectory.hand.transforms_hand_to_world, values))


def start_of(take, body, by):
    """The take whose scene has its object or its hand elsewhere."""
    name = {"object": "transform_object_to_world", "hand": "transform_hand_to_world"}[body]
    part = getattr(take.scene, body)
    transform = getattr(part, name).copy()
    transform[:3, 3] += by
    elsewhere = replace(part, **{name: transform})
    change = {"hands": {"hand": elsewhere}} if body == "hand" else {body: elsewhere}
    return replace(take, scene=replace(take.scene, **change))


def third_view(take, flip):
    view = take.scene.third_view
    moved = replace(view, transforms_world_to_camera=np.diag(flip) @ view.transforms_world_to_camera)
    return replace(take, scene=replace(take.scene, third_view=moved))


def moved(*by):
    def change(frames):
        frames[..., :3, 3] += by
        return frames

    return change


def turned(degrees, axis="z"):
    def change(frames):
        frames[..., :3, :3] = (
            Rotation.from_euler(axis, degrees, degrees=True).as_matrix() @ frames[..., :3, :3]
        )
        return frames

    return change


def mirrored(frames):
    frames[..., :3, 0] *= -1.0
    return frames


def forwards(distance):
    def change(frames):
        frames[..., :3, 3] += distance * frames[..., :3, 2]
        return frames

    return change


def sideways(distance):
    def change(frames):
        frames[..., :3, 3] += distance * frames[..., :3, 0]
        return frames

    return change


def held(take):
    return slice(always.contact(take), None)


def into_the_object(take):
    return hand(
        take, 3, lambda pose: np.broadcast_to(take.scene.object.transform_object_to_world, pose.shape)
    )


def shifted_marker(take, by):
    return trajectory(take, marker_points=take.trajectory.marker_points + np.asarray(by))


BREAKS = {
    start.the_object_rests_upright_on_the_floor: lambda t: start_of(t, "object", [0, 0, TINY]),
    start.the_hand_starts_above_the_floor_and_the_object: lambda t: start_of(t, "hand", [0, 0, -0.3]),
    start.the_hand_points_near_the_object: lambda t: start_of(t, "hand", [0.11, 0, 0]),
    start.the_hand_camera_has_the_object_in_its_first_frame: lambda t: start_of(t, "object", [0, 0, 1]),
    start.the_third_camera_has_object_and_hand_in_its_first_frame: lambda t: start_of(t, "hand", [1, 1, 0]),
    start.the_third_camera_is_above_the_floor_and_looks_at_the_midpoint: lambda t: third_view(
        t, [-1, -1, 1, 1]
    ),
    always.hand_frames_are_right_handed_rotations: lambda t: hand(t, 7, mirrored),
    always.poses_hold_continuous_unit_quaternions_from_the_reference_on: lambda t: hand(t, 7, turned(30)),
    always.it_starts_from_the_scene: lambda t: hand(t, 0, moved(TINY, 0, 0)),
    always.every_step_has_all_its_parts: lambda t: trajectory(t, phases=t.trajectory.phases[1:]),
    always.the_object_never_sinks_below_the_floor_nor_tilts: lambda t: solid(t, 5, moved(0, 0, -TINY)),
    always.the_hands_origin_stays_above_the_floor: lambda t: hand(t, 30, moved(0, 0, -1)),
    always.the_object_waits_and_then_moves_with_the_hand: lambda t: solid(t, -1, moved(TINY, 0, 0)),
    always.the_approach_is_a_straight_line_at_even_steps: lambda t: hand(t, 5, moved(TINY, 0, 0)),
    always.the_hand_is_outside_the_object_from_contact_on: lambda t: hand(t, -1, forwards(0.03)),
    grasping.the_grasps_forward_axis_meets_the_objects_centre: lambda t: hand(t, held(t), sideways(TINY)),
    grasping.the_grasp_point_lies_outside_the_nearest_slender_face: lambda t: hand(
        t, held(t), forwards(-0.02)
    ),
    grasping.forward_follows_the_papers_slerp_and_nothing_twists: lambda t: hand(t, 5, turned(0.01)),
    grasping.the_hand_is_never_inside_the_object: into_the_object,
    grasping.pick_closes_at_the_last_step_only: lambda t: gripper(t, -2, 1.0),
    grasping.pick_leaves_the_object_and_draws_no_marker: lambda t: solid(t, -1, moved(TINY, 0, 0)),
    grasping.place_grasps_half_way_and_opens_at_the_goal: lambda t: gripper(t, -1, 1.0),
    grasping.place_ends_where_the_papers_equations_say: lambda t: hand(t, -1, moved(TINY, 0, 0)),
    grasping.transport_is_a_bezier_curve_that_leaves_and_lands_vertically: lambda t: hand(
        t, 30, moved(TINY, 0, 0)
    ),
    grasping.transport_turns_steadily_about_world_up: lambda t: hand(t, 30, turned(0.01)),
    pushing.the_gripper_stays_open_and_half_the_steps_push: lambda t: gripper(t, -1, 1.0),
    pushing.the_hand_is_upright_and_looks_along_the_push: lambda t: hand(t, held(t), turned(0.01)),
    pushing.the_push_starts_and_ends_behind_the_objects_centre: lambda t: hand(t, held(t), sideways(TINY)),
    pushing.a_small_gap_parts_the_cube_from_the_object: lambda t: hand(t, held(t), forwards(0.01)),
    pushing.the_push_is_a_straight_level_line_at_even_steps: lambda t: hand(t, 30, moved(0, 0, TINY)),
    pushing.the_object_does_not_turn: lambda t: solid(t, -1, turned(0.01)),
    pushing.the_approach_turns_at_a_constant_rate_the_shorter_way: lambda t: hand(t, 5, turned(0.01)),
    marker.the_marker_lies_flat_on_the_floor_and_in_the_third_view: lambda t: shifted_marker(t, [0, 0, TINY]),
    marker.the_marker_lies_at_its_distance_on_the_floor: lambda t: solid(t, -1, moved(0.6, 0, 0)),
    marker.the_object_ends_on_its_marker: lambda t: shifted_marker(t, [0.01, 0, 0]),
    marker.the_marker_is_dense: lambda t: trajectory(t, marker_points=t.trajectory.marker_points[::2]),
}
EACH = [
    pytest.param(motion, law, id=f"{motion}-{law.__name__}") for motion, laws in LAWS.items() for law in laws
]


@pytest.mark.parametrize(("motion", "law"), EACH)
def test_a_broken_episode_breaks_its_law(takes, motion, law):
    for take in takes(motion, count=4):
        law(take)
        with pytest.raises(AssertionError):
            law(BREAKS[law](take))
