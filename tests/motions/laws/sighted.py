"""What the packaged config `sighted` promises of every episode, one function a sentence.

Hand, fingers and arm are taken from what the third-person camera is given to draw, and not from what the
motions believe of them.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from geoprior.geometry.se3 import apply, invert
from geoprior.scene.mesh import bounds
from laws import always, marker

GRAZE = 1e-6
"""Metres: two surfaces that touch may overlap by so much through rounding."""
HAND_PARTS = {"hand", "finger"}


def boxes(take, parts=HAND_PARTS):
    """The hand's boxes: low and high corner (3,), and poses (N, 4, 4)."""
    for cloud in take.shots["third"].clouds:
        if cloud.body in parts:
            yield *bounds(cloud.surface), cloud.transforms_cloud_to_world


def surface(take):
    """(N, P, 3) the object's vertices and surface points over time."""
    points = np.vstack([take.scene.object.mesh.vertices, take.scene.object.points])
    return apply(take.trajectory.transforms_object_to_world, points[None])


def depth_in_box(points, low, high, poses):
    """How deep the deepest of world points (N, P, 3) lies in a box, metres; below 0 outside."""
    local = apply(invert(poses), points)
    return np.minimum(local - low, high - local).min(axis=-1).max()


def the_hand_has_a_cube_and_two_fingers(take):
    assert len(list(boxes(take))) == 3


def nothing_of_the_hand_goes_below_the_floor(take):
    for low, high, poses in boxes(take):
        corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)
        assert apply(poses, corners[None])[..., 2].min() > take.scene.floor.height


def nothing_of_the_arm_goes_below_the_floor_or_into_the_object(take):
    points = surface(take)
    arm = [cloud for cloud in take.shots["third"].clouds if cloud.body == "arm"]
    assert len(arm) == 4
    for cloud in arm:
        poses = np.broadcast_to(cloud.transforms_cloud_to_world, (take.trajectory.steps, 4, 4))
        low, high = bounds(cloud.surface)
        assert apply(poses, corners(low, high)[None])[..., 2].min() > take.scene.floor.height - GRAZE
        assert depth_in_box(points, low, high, poses) < GRAZE


def distractors_lie_apart_from_all_that_happens(take):
    solids = [cloud for cloud in take.shots["third"].clouds if cloud.body == "distractor"]
    assert len(solids) <= 2
    object_points = surface(take).reshape(-1, 3)[::7, :2]
    for solid in solids:
        points = apply(solid.transforms_cloud_to_world, solid.surface.vertices)
        assert abs(points[:, 2].min() - take.scene.floor.height) < 1e-9
        middle = solid.transforms_cloud_to_world[:2, 3]
        assert 0.26 - 1e-9 <= np.linalg.norm(middle) <= 0.45 + 1e-9
        radius = np.linalg.norm(points[:, :2] - middle, axis=1).max()
        assert np.linalg.norm(object_points - middle, axis=1).min() > radius + 0.03 - 1e-9
        if take.trajectory.marker_points is not None:
            away = np.linalg.norm(take.trajectory.marker_points[:, :2] - middle, axis=1)
            assert away.min() > radius + 0.03 - 1e-9
        for low, high, poses in boxes(take):
            steps = np.broadcast_to(points[None], (take.trajectory.steps, *points.shape))
            assert depth_in_box(steps, low, high, poses) < GRAZE


def no_point_of_the_object_is_inside_the_hand(take):
    points = surface(take)
    for low, high, poses in boxes(take):
        assert depth_in_box(points, low, high, poses) < GRAZE


def both_first_frames_have_the_object(take):
    scene = take.scene
    hand = scene.hand.transform_hand_to_world @ scene.hand.transform_camera_to_hand
    for view, to_world, points in (
        (scene.hand.view, hand, scene.object.centre[None]),
        (scene.third_view, invert(scene.third_view.transforms_world_to_camera), scene.object.vertices),
    ):
        local = (points - to_world[:3, 3]) @ to_world[:3, :3]
        pixels = (local @ view.intrinsics.T)[:, :2] / local[:, 2:]
        assert local[:, 2].min() > 0.0
        assert pixels.min() >= 0.0
        assert np.all(pixels.max(axis=0) <= [view.width - 1.0, view.height - 1.0])


def the_object_never_jumps_or_turns_but_with_the_hand(take):
    trajectory = take.trajectory
    held = np.isin(trajectory.phases, ["lift", "transport"])
    at_rest = trajectory.transforms_object_to_world[: np.argmax(held) if held.any() else None]
    if "push" not in trajectory.phases:
        np.testing.assert_array_equal(at_rest, np.broadcast_to(at_rest[0], at_rest.shape))
    relative = invert(trajectory.hand.transforms_hand_to_world) @ trajectory.transforms_object_to_world
    carried = relative[held]
    np.testing.assert_allclose(carried, np.broadcast_to(carried[:1], carried.shape), atol=1e-9)
    steps = np.linalg.norm(np.diff(trajectory.transforms_object_to_world[:, :3, 3], axis=0), axis=1)
    hand = np.linalg.norm(np.diff(trajectory.hand.transforms_hand_to_world[:, :3, 3], axis=0), axis=1)
    assert steps.max() < max(0.12, 2.0 * hand.max())


def the_quaternions_are_continuous(take):
    quaternions = take.trajectory.pose()[:, 3:7].astype(np.float64)
    assert np.sum(quaternions[1:] * quaternions[:-1], axis=1).min() > 0.9
    assert quaternions[0] @ always.STRAIGHT_DOWN > 0.3


def the_fingers_close_while_the_hand_waits(take):
    trajectory = take.trajectory
    apart = trajectory.hand.fingers_apart()
    assert np.all((apart >= 0.0) & (apart <= 1.0))
    grasping = np.array(trajectory.phases) == "grasp"
    assert np.all(trajectory.hand.gripper[grasping] == 1.0)
    still = trajectory.hand.transforms_hand_to_world[grasping]
    np.testing.assert_allclose(still, np.broadcast_to(still[:1], still.shape), atol=1e-12)
    assert np.all(np.diff(apart[grasping]) < 0.0)


def the_object_lies_between_the_fingers(take):
    """At the grasp the hand's origin is over the object's middle, and the finger tips are below its top."""
    trajectory = take.trajectory
    grasp = trajectory.hand.transforms_hand_to_world[trajectory.phases.index("grasp")]
    local = invert(take.scene.object.transform_object_to_world) @ grasp
    np.testing.assert_allclose(local[:2, 3], 0.0, atol=1e-9)
    fingers, top = take.scene.hand.fingers, take.scene.object.vertices[:, 2].max()
    assert grasp[2, 3] + fingers.past * grasp[2, 2] < top - 0.004
    assert grasp[2, 2] < -np.cos(np.radians(5.1)), "from above"
    assert 0.0 < trajectory.hand.grip < fingers.opening


def the_lifted_object_is_up_and_the_gripper_closed(take):
    rise = take.trajectory.transforms_object_to_world[-1, 2, 3] - take.scene.object.centre[2]
    assert 0.1 - 1e-9 <= rise <= 0.18 + 1e-9
    assert take.trajectory.hand.gripper[-1] == 1.0


def the_open_hand_rises_from_the_placed_object(take):
    trajectory = take.trajectory
    assert trajectory.hand.gripper[-1] == 0.0
    placed = trajectory.phases.index("release")
    way = trajectory.hand.transforms_hand_to_world[:, 2, 3]
    assert 0.05 - 1e-9 <= way[-1] - way[placed] <= 0.1 + 1e-9
    rest = trajectory.transforms_object_to_world[placed:]
    np.testing.assert_allclose(rest, np.broadcast_to(rest[-1], rest.shape), atol=1e-9)
    assert abs(rest[-1, 2, 3] - take.scene.object.centre[2]) < 1e-9, "it stands on the floor again"


def the_closed_hand_stays_behind_the_object_and_ends_with_it(take):
    trajectory = take.trajectory
    np.testing.assert_array_equal(trajectory.hand.gripper, [0.0] + [1.0] * (trajectory.steps - 1))
    first = trajectory.phases.index("push")
    centres = trajectory.transforms_object_to_world[:, :3, 3]
    v_push = (centres[-1] - centres[0]) / np.linalg.norm(centres[-1] - centres[0])
    assert abs(v_push[2]) < 1e-9
    off = centres - centres[0]
    np.testing.assert_allclose(off - (off @ v_push)[:, None] * v_push, 0.0, atol=1e-9)
    assert np.all(np.diff(off @ v_push) >= -1e-12)
    assert np.all(trajectory.hand.transforms_hand_to_world[first - 1 :, 2, 2] < -np.cos(np.radians(5.1)))
    back = (surface(take)[-1] @ v_push).min()
    fingers = boxes(take, {"finger"})
    ahead = max((apply(poses[-1], corners(low, high)) @ v_push).max() for low, high, poses in fingers)
    assert 0.0005 - 1e-9 <= back - ahead <= 0.002 + 1e-9, "the fingers push it, as near as `gap` says"


def corners(low, high):
    return np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)


def the_marker_lies_flat_on_the_floor_and_in_the_third_view(take):
    scene, points = take.scene, take.trajectory.marker_points
    np.testing.assert_array_equal(points[:, 2], scene.floor.height)
    assert np.abs(points[:, :2]).max() <= 0.5 * scene.floor.side
    local = apply(scene.third_view.transforms_world_to_camera, points)
    pixels = (local @ scene.third_view.intrinsics.T)[:, :2] / local[:, 2:]
    assert local[:, 2].min() > 0.0
    assert pixels.min() >= 0.0
    assert np.all(pixels.max(axis=0) <= [scene.third_view.width - 1.0, scene.third_view.height - 1.0])


def the_object_ends_within_its_marker(take):
    """Of a band, within what it goes round: markers may be larger than the object."""
    trajectory = take.trajectory
    footprint = apply(trajectory.transforms_object_to_world[-1], take.scene.object.mesh.vertices)
    hull = ConvexHull(trajectory.marker_surface.vertices[:, :2])
    for inside in (footprint, trajectory.marker_points):
        assert (inside[:, :2] @ hull.equations[:, :2].T + hull.equations[:, 2]).max() < 1e-9


ALL = (
    always.hand_frames_are_right_handed_rotations,
    always.it_starts_from_the_scene,
    always.every_step_has_all_its_parts,
    always.the_object_never_sinks_below_the_floor_nor_tilts,
    always.the_hands_origin_stays_above_the_floor,
    the_hand_has_a_cube_and_two_fingers,
    nothing_of_the_hand_goes_below_the_floor,
    no_point_of_the_object_is_inside_the_hand,
    nothing_of_the_arm_goes_below_the_floor_or_into_the_object,
    distractors_lie_apart_from_all_that_happens,
    both_first_frames_have_the_object,
    the_object_never_jumps_or_turns_but_with_the_hand,
    the_quaternions_are_continuous,
)
GRASPS = (the_fingers_close_while_the_hand_waits, the_object_lies_between_the_fingers)
GOAL = (
    the_marker_lies_flat_on_the_floor_and_in_the_third_view,
    marker.the_marker_lies_at_its_distance_on_the_floor,
    the_object_ends_within_its_marker,
)
SIGHTED = {
    "pick": (*ALL, *GRASPS, the_lifted_object_is_up_and_the_gripper_closed),
    "place": (*ALL, *GRASPS, *GOAL, the_open_hand_rises_from_the_placed_object),
    "push": (*ALL, *GOAL, the_closed_hand_stays_behind_the_object_and_ends_with_it),
}
"""The laws of each motion under that config."""
