"""Pick and place: the grasp heuristic, the gripper, the paper's equations of placing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoprior.geometry.se3 import invert, make_transform
from geoprior.hooks.manager import plugins
from geoprior.motions._grasp import GraspOptions, grasp_position
from geoprior.motions.place import transport
from geoprior.options import Choice
from geoprior.scene.hand import hand_rotation
from geoprior.scene.mesh import convex_mesh


def with_box(scene, size, hand):
    """The same scene with a box of this size at yaw 0 on the origin and the hand at a place."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    transform = make_transform(np.eye(3), np.array([0.0, 0.0, 0.5 * size[2] + scene.floor.height]))
    box = replace(
        scene.object, mesh=convex_mesh(corners * size), transform_object_to_world=transform, yaw=0.0
    )
    pose = make_transform(hand_rotation(np.array([0.0, 0.0, -1.0]), 0.0), np.asarray(hand, dtype=float))
    return replace(scene, object=box, hand=replace(scene.hand, transform_hand_to_world=pose))


@pytest.mark.parametrize(
    ("size", "hand", "outward"),
    [
        ((0.10, 0.03, 0.03), (0.2, 0.01, 0.3), (1, 0, 0)),
        ((0.10, 0.03, 0.03), (-0.2, 0.01, 0.3), (-1, 0, 0)),
        ((0.03, 0.10, 0.03), (0.1, -0.2, 0.3), (0, -1, 0)),
        ((0.03, 0.03, 0.10), (0.3, 0.0, 0.3), (0, 0, 1)),
        ((0.05, 0.05, 0.05), (0.01, 0.0, 0.4), (0, 0, 1)),
        ((0.10, 0.10, 0.02), (0.2, 0.05, 0.2), (1, 0, 0)),
    ],
)
def test_the_face_is_slender_and_on_the_hands_side(takes, size, hand, outward):
    scene = with_box(takes("pick")[0].scene, size, hand)
    point = grasp_position(scene, GraspOptions(offset=(0.01, 0.01)), np.random.default_rng(0))
    expected = scene.object.centre + (0.5 * np.array(size) + 0.01) * np.array(outward)
    np.testing.assert_allclose(point, expected, atol=1e-12)


def test_a_hand_straight_above_a_lying_bar_takes_one_end_and_arrives(takes):
    scene = with_box(takes("pick")[0].scene, (0.12, 0.03, 0.03), (0.0, 0.0, 0.3))
    planner = plugins().build("motion", Choice(name="pick"))
    frames = planner.plan(scene, 30, np.random.default_rng(0)).transforms_hand_to_world
    assert np.isfinite(frames).all()
    assert abs(frames[-1, 0, 2]) == pytest.approx(1.0)


def test_a_hand_that_looks_away_from_the_object_still_turns_to_it(takes):
    scene = with_box(takes("pick")[0].scene, (0.03, 0.03, 0.10), (0.0, 0.0, 0.4))
    away = make_transform(np.eye(3), scene.hand.position)
    scene = replace(scene, hand=replace(scene.hand, transform_hand_to_world=away))
    planner = plugins().build("motion", Choice(name="pick"))
    frames = planner.plan(scene, 30, np.random.default_rng(0)).transforms_hand_to_world[:, :3, :3]
    np.testing.assert_allclose(frames[-1, :, 2], [0.0, 0.0, -1.0], atol=1e-9)
    turns = Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]).magnitude()
    np.testing.assert_allclose(turns, np.pi / 29, atol=1e-9)


@pytest.mark.parametrize("motion", ["pick", "place"])
def test_the_grasps_forward_axis_meets_the_objects_centre(takes, motion):
    for take in takes(motion):
        grasp = take.trajectory.transforms_hand_to_world[take.trajectory.phases.index("grasp")]
        to_centre = take.scene.object.centre - grasp[:3, 3]
        distance = to_centre @ grasp[:3, 2]
        assert distance > 0.0
        assert np.linalg.norm(to_centre - distance * grasp[:3, 2]) < 1e-9


@pytest.mark.parametrize("motion", ["pick", "place"])
def test_the_grasp_point_is_slightly_outside_the_bounding_box(takes, motion):
    for take in takes(motion):
        grasp = take.trajectory.transforms_hand_to_world[take.trajectory.phases.index("grasp"), :3, 3]
        local = (invert(take.scene.object.transform_object_to_world) @ [*grasp, 1.0])[:3]
        half = take.scene.object.mesh.vertices.max(axis=0)
        outside = np.abs(local) - half
        assert 0.005 - 1e-9 <= outside.max() <= 0.02 + 1e-9
        assert np.sort(np.abs(local))[1] < 1e-9, "on the normal through the face's middle"


def test_grasps_come_from_above_and_from_the_sides(takes):
    down = [take.trajectory.transforms_hand_to_world[-1, 2, 2] < -0.99 for take in takes("pick")]
    assert 0.3 < np.mean(down) < 0.9


def test_positions_of_the_approach_lie_on_a_line_at_even_steps(takes):
    for take in takes("pick"):
        positions = take.trajectory.transforms_hand_to_world[:, :3, 3]
        steps = np.diff(positions, axis=0)
        np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-12)


def test_pick_closes_at_the_last_step_only(takes):
    for take in takes("pick"):
        np.testing.assert_array_equal(take.trajectory.gripper, [0.0] * 39 + [1.0])
        moved = take.trajectory.transforms_object_to_world
        np.testing.assert_array_equal(moved, np.broadcast_to(moved[0], moved.shape))


def test_pick_can_hold_on(takes):
    for take in takes("pick", count=3, closed=5):
        np.testing.assert_array_equal(take.trajectory.gripper, [0.0] * 35 + [1.0] * 5)
        last = take.trajectory.transforms_hand_to_world[-5:]
        np.testing.assert_array_equal(last, np.broadcast_to(last[0], last.shape))


@pytest.mark.parametrize(("closed", "opened"), [(1, 1), (4, 3)])
def test_place_opens_closes_and_opens(takes, closed, opened):
    for take in takes("place", count=20, closed=closed, opened=opened):
        trajectory = take.trajectory
        expected = [1.0 if phase in {"grasp", "transport"} else 0.0 for phase in trajectory.phases]
        np.testing.assert_array_equal(trajectory.gripper, expected)
        assert trajectory.phases.count("grasp") == closed
        assert trajectory.phases.count("release") == opened
        for phase in ("grasp", "release"):
            first = trajectory.phases.index(phase)
            still = trajectory.transforms_hand_to_world[first : first + trajectory.phases.count(phase)]
            np.testing.assert_array_equal(still, np.broadcast_to(still[0], still.shape))


def test_place_ends_where_the_papers_equations_say(takes):
    yaws = []
    for take in takes("place"):
        trajectory, scene = take.trajectory, take.scene
        grasp = trajectory.transforms_hand_to_world[trajectory.phases.index("grasp")]
        start, goal = trajectory.transforms_object_to_world[[0, -1]]
        random_rotation = goal[:3, :3] @ start[:3, :3].T
        delta = grasp[:3, 3] - scene.object.centre
        final = trajectory.transforms_hand_to_world[-1]
        np.testing.assert_allclose(final[:3, 3], goal[:3, 3] + random_rotation @ delta, atol=1e-9)
        np.testing.assert_allclose(final[:3, :3], random_rotation @ grasp[:3, :3], atol=1e-9)
        np.testing.assert_allclose(random_rotation[2], [0.0, 0.0, 1.0], atol=1e-9)
        yaws.append(np.degrees(np.arctan2(random_rotation[1, 0], random_rotation[0, 0])))
    assert np.abs(yaws).max() <= 90.0
    assert np.std(yaws) > 35.0


def test_transport_lifts_off_and_lands_and_turns_steadily():
    grasp = make_transform(Rotation.random(random_state=1).as_matrix(), np.array([0.02, 0.0, 0.1]))
    centre, goal = np.array([0.0, 0.0, 0.03]), np.array([0.2, 0.1, 0.03])
    frames = transport(grasp, centre, goal, 3.0, 0.16, 60)
    heights = frames[:, 2, 3]
    assert np.all(heights[:-1] > 0.1)
    assert heights[-1] == pytest.approx(0.1)
    assert heights.max() == pytest.approx(0.1 + 0.75 * 0.16, abs=1e-3), "the middle of the Bézier curve"
    path = np.concatenate([grasp[None], frames])[:, :3, :3]
    turns = Rotation.from_matrix(path[1:] @ np.swapaxes(path[:-1], 1, 2)).as_rotvec()
    np.testing.assert_allclose(turns, np.broadcast_to([0.0, 0.0, 3.0 / 60], turns.shape), atol=1e-9)


def test_the_object_is_off_the_floor_while_it_is_carried(takes):
    for take in takes("place"):
        trajectory = take.trajectory
        first = trajectory.phases.index("transport")
        last = trajectory.phases.index("release")
        rise = trajectory.transforms_object_to_world[first:last, 2, 3] - take.scene.object.centre[2]
        assert np.all(rise > 0.0)
        assert 0.055 < rise.max() < 0.16
