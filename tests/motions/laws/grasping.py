"""Pick and place: the grasp, the gripper, and the paper's equations of placing."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from geoprior.geometry.se3 import invert
from laws.solids import depth_of_the_hand_in_the_object

LIFT = (0.08, 0.2)


def grasp_pose(take):
    return take.trajectory.hand.transforms_hand_to_world[take.trajectory.phases.index("grasp")]


def the_grasps_forward_axis_meets_the_objects_centre(take):
    grasp = grasp_pose(take)
    to_centre = take.scene.object.centre - grasp[:3, 3]
    assert to_centre @ grasp[:3, 2] > 0.0
    assert np.linalg.norm(np.cross(to_centre, grasp[:3, 2])) < 1e-9


def the_grasp_point_lies_outside_the_nearest_slender_face(take):
    scene = take.scene
    local = invert(scene.object.transform_object_to_world)
    point, start = local[:3, :3] @ grasp_pose(take)[:3, 3] + local[:3, 3], local @ [*scene.hand.position, 1.0]
    size = np.ptp(scene.object.mesh.vertices, axis=0)
    axis = int(np.argmax(np.abs(point)))
    outside = abs(point[axis]) - 0.5 * size[axis]
    assert 0.005 - 1e-9 <= outside <= 0.02 + 1e-9, "slightly outside its face"
    assert np.abs(np.delete(point, axis)).max() < 1e-9, "on the normal through the face's middle"
    areas = np.array([size[1] * size[2], size[2] * size[0], size[0] * size[1]])
    slender = areas <= 1.25 * areas.min()
    assert slender[axis]
    assert point[axis] * start[axis] > -1e-15, "of two opposite faces the one on the hand's side"
    middle = np.where(np.arange(3) == axis, np.copysign(0.5 * size, point), 0.0)
    for other in np.flatnonzero(slender):
        rival = np.where(np.arange(3) == other, np.copysign(0.5 * size, start[:3]), 0.0)
        assert np.linalg.norm(middle - start[:3]) <= np.linalg.norm(rival - start[:3]) + 1e-12


def forward_follows_the_papers_slerp_and_nothing_twists(take):
    grasp = take.trajectory.phases.index("grasp")
    frames = take.trajectory.hand.transforms_hand_to_world[: grasp + 1, :3, :3]
    first, last = frames[0, :, 2], frames[-1, :, 2]
    theta = np.arctan2(np.linalg.norm(np.cross(first, last)), first @ last)
    times = np.linspace(0.0, 1.0, len(frames))[:, None]
    expected = np.sin((1.0 - times) * theta) * first + np.sin(times * theta) * last
    np.testing.assert_allclose(frames[:, :, 2], expected / np.sin(theta), atol=1e-7)
    turns = Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]).as_rotvec()
    np.testing.assert_allclose(np.linalg.norm(turns, axis=1), theta / (len(frames) - 1), atol=1e-9)
    assert np.abs(turns[:, 2]).max() < 1e-9, "right and up are carried without a turn about forward"


def the_hand_is_never_inside_the_object(take):
    trajectory, scene = take.trajectory, take.scene
    relative = invert(trajectory.transforms_object_to_world) @ trajectory.hand.transforms_hand_to_world
    assert depth_of_the_hand_in_the_object(scene.object.mesh, scene.hand.cube, relative).max() <= 1e-9


def pick_closes_at_the_last_step_only(take):
    steps = len(take.trajectory.hand.gripper)
    np.testing.assert_array_equal(take.trajectory.hand.gripper, [0.0] * (steps - 1) + [1.0])
    assert take.trajectory.phases == ("approach",) * (steps - 1) + ("grasp",)


def pick_leaves_the_object_and_draws_no_marker(take):
    moved = take.trajectory.transforms_object_to_world
    np.testing.assert_array_equal(moved, np.broadcast_to(moved[0], moved.shape))
    assert take.trajectory.marker_points is None


def place_grasps_half_way_and_opens_at_the_goal(take):
    gripper, phases = take.trajectory.hand.gripper, take.trajectory.phases
    first, steps = round(0.5 * len(gripper)) - 1, len(gripper)
    np.testing.assert_array_equal(gripper, [0.0] * first + [1.0] * (steps - first - 1) + [0.0])
    expected = ["approach"] * first + ["grasp"] + ["transport"] * (steps - first - 2) + ["release"]
    assert list(phases) == expected


def place_ends_where_the_papers_equations_say(take):
    trajectory, grasp = take.trajectory, grasp_pose(take)
    start, goal = trajectory.transforms_object_to_world[[0, -1]]
    r_rand = goal[:3, :3] @ start[:3, :3].T
    delta_p = grasp[:3, 3] - start[:3, 3]
    placed = trajectory.hand.transforms_hand_to_world[-1]
    np.testing.assert_allclose(placed[:3, 3], goal[:3, 3] + r_rand @ delta_p, atol=1e-9)
    np.testing.assert_allclose(placed[:3, :3], r_rand @ grasp[:3, :3], atol=1e-9)
    np.testing.assert_allclose(r_rand[2], [0.0, 0.0, 1.0], atol=1e-9)
    assert abs(np.arctan2(r_rand[1, 0], r_rand[0, 0])) <= np.pi / 2 + 1e-9
    assert abs(goal[2, 3] - start[2, 3]) < 1e-9, "it stands on the floor again"


def transport_is_a_bezier_curve_that_leaves_and_lands_vertically(take):
    first = take.trajectory.phases.index("grasp")
    path = take.trajectory.hand.transforms_hand_to_world[first:, :3, 3]
    t = np.linspace(0.0, 1.0, len(path))
    early, late = 3.0 * t * (1.0 - t) ** 2, 3.0 * t**2 * (1.0 - t)
    ends = ((1.0 - t) ** 3 + early)[:, None] * path[0] + (t**3 + late)[:, None] * path[-1]
    rise = (path - ends)[:, 2]
    lift = rise[1:-1] / (early + late)[1:-1]
    np.testing.assert_allclose(lift, lift[0], atol=1e-9)
    assert LIFT[0] - 1e-9 <= lift[0] <= LIFT[1] + 1e-9
    np.testing.assert_allclose((path - ends)[:, :2], 0.0, atol=1e-12)
    lifted = take.trajectory.transforms_object_to_world[first + 1 : -1, 2, 3] - take.scene.object.centre[2]
    assert lifted.min() > 0.0


def transport_turns_steadily_about_world_up(take):
    first = take.trajectory.phases.index("grasp")
    frames = take.trajectory.hand.transforms_hand_to_world[first:, :3, :3]
    turns = Rotation.from_matrix(frames[1:] @ np.swapaxes(frames[:-1], 1, 2)).as_rotvec()
    np.testing.assert_allclose(turns, np.broadcast_to([0.0, 0.0, turns[0, 2]], turns.shape), atol=1e-9)


GRASPING = (
    the_grasps_forward_axis_meets_the_objects_centre,
    the_grasp_point_lies_outside_the_nearest_slender_face,
    forward_follows_the_papers_slerp_and_nothing_twists,
    the_hand_is_never_inside_the_object,
)
PICK = (
    pick_closes_at_the_last_step_only,
    pick_leaves_the_object_and_draws_no_marker,
)
PLACE = (
    place_grasps_half_way_and_opens_at_the_goal,
    place_ends_where_the_papers_equations_say,
    transport_is_a_bezier_curve_that_leaves_and_lands_vertically,
    transport_turns_steadily_about_world_up,
)
