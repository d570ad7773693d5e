"""Pick and place: the grasp heuristic, the gripper, the paper's equations of placing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from geoprior.geometry.se3 import make_transform
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
    return replace(scene, object=box, hands={"hand": replace(scene.hand, transform_hand_to_world=pose)})


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
    frames = planner.plan(scene, 30, np.random.default_rng(0)).hand.transforms_hand_to_world
    assert np.isfinite(frames).all()
    assert abs(frames[-1, 0, 2]) == pytest.approx(1.0)


def test_a_hand_that_looks_away_from_the_object_still_turns_to_it(takes):
    scene = with_box(takes("pick")[0].scene, (0.03, 0.03, 0.10), (0.0, 0.0, 0.4))
    away = make_transform(np.eye(3), scene.hand.position)
    scene = replace(scene, hands={"hand": replace(scene.hand, transform_hand_to_world=away)})
    planner = plugins().build("motion", Choice(name="pick"))
    frames = planner.plan(scene, 30, np.random.default_rng(0)).hand.transforms_hand_to_world[:, :3, :3]
    np.testing.assert_allclose(frames[-1, :, 2], [0.0, 0.0, -1.0], atol=1e-9)
    turns = Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]).magnitude()
    np.testing.assert_allclose(turns, np.pi / 29, atol=1e-9)


def test_grasps_come_from_above_and_from_the_sides(takes):
    down = [take.trajectory.hand.transforms_hand_to_world[-1, 2, 2] < -0.99 for take in takes("pick")]
    assert 0.3 < np.mean(down) < 0.9


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


def test_places_turn_either_way_by_up_to_a_quarter(takes):
    yaws = []
    for take in takes("place"):
        start, goal = take.trajectory.transforms_object_to_world[[0, -1], :3, :3]
        r_rand = goal @ start.T
        yaws.append(np.degrees(np.arctan2(r_rand[1, 0], r_rand[0, 0])))
    assert kstest(yaws, "uniform", args=(-90.0, 180.0)).pvalue > 1e-3


def test_place_lifts_the_object_clear_of_the_floor(takes):
    for take in takes("place"):
        heights = take.trajectory.transforms_object_to_world[:, 2, 3] - take.scene.object.centre[2]
        assert 0.055 < heights.max() < 0.16
