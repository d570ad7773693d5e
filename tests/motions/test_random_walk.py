"""Random walk: whole and smooth like every motion, above the floor, and blind to the object."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoprior.errors import ConfigError
from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.se3 import apply, make_transform, pose_vectors
from geoprior.hooks.manager import plugins
from geoprior.motions.random_walk import working_frame
from geoprior.motions.trajectory import Trajectory
from geoprior.options import Choice
from geoprior.scene.hand import hand_rotation
from geoprior.scene.scene import Scene
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import stage_episode

CAMERAS = CamerasConfig()
COUNT = 40
LOWEST = 0.01
"""Metres above the floor: the default waypoints' lowest."""


class Walk(NamedTuple):
    scene: Scene
    trajectory: Trajectory


def staged(motion, count=COUNT):
    config = GenerateConfig(fps=41, seconds=1.0)
    return [stage_episode(config, CAMERAS, 23, Choice(name=motion), index) for index in range(count)]


@pytest.fixture(scope="module")
def takes():
    """Walks of 41 steps, so that the waypoints of four legs fall on every tenth."""
    return staged("random-walk")


@pytest.fixture(scope="module")
def walks(takes):
    """``walks(**options)``: from the same scenes, with other options."""

    def get(count=COUNT, steps=41, **options):
        return [
            Walk(take.scene, plan(take.scene, seed, steps, **options))
            for seed, take in enumerate(takes[:count])
        ]

    return get


def plan(scene, seed=0, steps=41, **options):
    planner = plugins().build("motion", Choice(name="random-walk", options=options))
    return planner.plan(scene, steps, np.random.default_rng(seed))


def positions(trajectory):
    return trajectory.hand.transforms_hand_to_world[:, :3, 3]


def speeds(trajectory):
    """Metres from step to step."""
    return np.linalg.norm(np.diff(positions(trajectory), axis=0), axis=1)


def turns(trajectory):
    """Degrees from step to step."""
    frames = trajectory.hand.transforms_hand_to_world[:, :3, :3]
    return np.degrees(Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]).magnitude())


def lowest_of_the_cube(walk):
    """(N,) the lowest corner of the hand's cube above the floor, metres; its corners are worked out here."""
    half = 0.5 * walk.scene.hand.cube
    corners = [[x, y, z] for x in (-half, half) for y in (-half, half) for z in (-2.0 * half, 0.0)]
    world = apply(walk.trajectory.hand.transforms_hand_to_world, np.array(corners))
    return world[..., 2].min(axis=1) - walk.scene.floor.height


def test_poses_are_whole_and_start_from_the_scene(takes):
    for take in takes:
        trajectory, frames = take.trajectory, take.trajectory.hand.transforms_hand_to_world
        assert np.isfinite(frames).all()
        rotations = frames[:, :3, :3]
        identity = np.broadcast_to(np.eye(3), rotations.shape)
        np.testing.assert_allclose(np.swapaxes(rotations, 1, 2) @ rotations, identity, atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(rotations), 1.0, atol=1e-9)
        np.testing.assert_array_equal(frames[:, 3], np.broadcast_to([0.0, 0.0, 0.0, 1.0], (41, 4)))
        np.testing.assert_allclose(frames[0], take.scene.hand.transform_hand_to_world, atol=1e-12)
        quaternions = pose_vectors(frames, trajectory.hand.gripper)[:, 3:7].astype(np.float64)
        assert np.sum(quaternions[1:] * quaternions[:-1], axis=1).min() > 0.99


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"height": (0.001, 0.001), "leg": (0.5, 1.0)},
        {"height": (0.001, 0.02), "tilt": 180.0, "turn": 180.0, "heading_spread": 180.0, "leg": (0.1, 1.0)},
    ],
)
def test_neither_hand_nor_cube_goes_below_the_lowest_waypoint(walks, options):
    lowest = options.get("height", (LOWEST,))[0]
    for take in walks(**options):
        assert lowest_of_the_cube(take).min() >= lowest - 1e-9
        assert (positions(take.trajectory)[:, 2] - take.scene.floor.height).min() >= lowest - 1e-9


def test_low_waypoints_are_reached(takes, walks):
    reached = [lowest_of_the_cube(take).min() for take in walks(height=(0.001, 0.001), leg=(0.5, 1.0))]
    np.testing.assert_allclose(reached, 0.001, atol=1e-9)
    assert min(lowest_of_the_cube(take).min() for take in takes) < 0.06


def test_the_object_rests_and_there_is_no_marker(takes):
    for take in takes:
        still = take.scene.object.transform_object_to_world
        assert take.trajectory.marker_points is None
        np.testing.assert_array_equal(
            take.trajectory.transforms_object_to_world, np.broadcast_to(still, (41, 4, 4))
        )


def test_another_object_elsewhere_changes_nothing(takes):
    for take, other in zip(takes[:20], reversed(takes), strict=False):
        scene = take.scene
        moved = make_transform(np.eye(3), np.array([0.1, -0.1, 0.2]))
        strange = replace(scene, object=replace(other.scene.object, transform_object_to_world=moved))
        for seed in range(3):
            walk, same = plan(scene, seed), plan(strange, seed)
            np.testing.assert_array_equal(
                same.hand.transforms_hand_to_world, walk.hand.transforms_hand_to_world
            )
            np.testing.assert_array_equal(same.hand.gripper, walk.hand.gripper)
            np.testing.assert_array_equal(same.transforms_object_to_world[-1], moved)


def test_planning_does_not_change_the_scene(takes):
    scene = takes[0].scene
    parts = (
        scene.hand.transform_hand_to_world,
        scene.hand.points,
        scene.object.transform_object_to_world,
        scene.object.points,
    )
    before = [part.copy() for part in parts]
    plan(scene)
    for part, was in zip(parts, before, strict=True):
        np.testing.assert_array_equal(part, was)


def test_the_draws_alone_decide_the_walk(takes):
    scene = takes[0].scene
    once, again, other = plan(scene, 1), plan(scene, 1), plan(scene, 2)
    np.testing.assert_array_equal(once.hand.transforms_hand_to_world, again.hand.transforms_hand_to_world)
    assert np.abs(positions(once) - positions(other)).max() > 0.02


def test_the_position_has_a_continuous_velocity(walks):
    for take in walks(count=20, steps=2001):
        velocity = np.diff(positions(take.trajectory)[:, :2], axis=0)
        jumps = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
        assert jumps.max() < 0.02 * speeds(take.trajectory).max()


def test_the_speeds_are_those_of_pick_place_and_push(takes):
    usual = np.concatenate(
        [speeds(take.trajectory) for name in ("pick", "place", "push") for take in staged(name, 40)]
    )
    walk = np.concatenate([speeds(take.trajectory) for take in takes])
    assert 0.75 < walk.mean() / usual.mean() < 1.33
    assert 0.75 < np.median(walk) / np.median(usual) < 1.33
    assert walk.max() < 2.0 * usual.max()
    assert np.quantile(walk, 0.95) < 1.5 * np.quantile(usual, 0.95)


def test_the_turns_are_no_faster_than_those_of_push(takes):
    usual = max(turns(take.trajectory).max() for take in staged("push", 40))
    walk = np.concatenate([turns(take.trajectory) for take in takes])
    assert walk.max() <= 60.0 / 10 + 1e-6
    assert walk.max() < usual


WAYPOINTS = [0, 10, 20, 30, 40]
"""The steps at which four legs of 41 steps begin and end."""


def test_waypoints_lie_in_the_workspace_and_all_over_it(walks):
    places = []
    for walk in walks(leg=(5.0, 5.0), reach=0.1, height=(0.05, 0.2)):
        reached = np.column_stack([positions(walk.trajectory)[:, :2], lowest_of_the_cube(walk)])
        places.append(reached[WAYPOINTS[1:]])
    places = np.concatenate(places)
    assert np.abs(places[:, :2]).max() <= 0.1 + 1e-9
    assert 0.05 - 1e-9 <= places[:, 2].min() <= places[:, 2].max() <= 0.2 + 1e-9
    np.testing.assert_allclose(places.mean(axis=0), [0.0, 0.0, 0.125], atol=0.015)
    np.testing.assert_allclose(places.std(axis=0), np.array([0.2, 0.2, 0.15]) / np.sqrt(12.0), rtol=0.1)


def test_legs_are_as_long_as_the_option_says(walks):
    for walk in walks(leg=(0.05, 0.06), reach=1.0, turn=0.0):
        legs = np.linalg.norm(np.diff(positions(walk.trajectory)[WAYPOINTS], axis=0), axis=1)
        assert 0.05 - 1e-9 <= legs.min() <= legs.max() <= 0.06 + 1e-9


def test_random_frames_fill_the_cone_about_straight_down():
    rng = np.random.default_rng(0)
    tilt, spread = np.radians(40.0), np.radians(20.0)
    frames = np.array([working_frame(tilt, spread, rng) for _ in range(500)])
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-9)
    down = -frames[:, 2, 2]
    assert down.min() >= np.cos(tilt) - 1e-12
    assert np.mean(down < 0.5 * (1.0 + np.cos(tilt))) == pytest.approx(0.5, abs=0.08), "evenly on the cap"
    assert np.abs(frames[:, :2, 2].mean(axis=0)).max() < 0.06, "in all directions"
    upright = np.array([working_frame(0.0, spread, rng) for _ in range(500)])
    headings = np.arctan2(upright[:, 1, 1], upright[:, 0, 1])
    assert spread * 0.9 < np.abs(headings).max() <= spread + 1e-9


def test_the_hand_turns_towards_the_cone(walks):
    straight_down = hand_rotation(np.array([0.0, 0.0, -1.0]), 0.0)
    for walk in walks(tilt=0.0, heading_spread=0.0):
        frames = walk.trajectory.hand.transforms_hand_to_world[:, :3, :3]
        left = Rotation.from_matrix(straight_down.T @ frames).magnitude()
        assert np.diff(left).max() <= 1e-6
        assert left[-1] < left[0]


def test_without_a_turn_the_frame_stays(walks):
    for take in walks(count=10, turn=0.0):
        assert turns(take.trajectory).max() < 1e-5


def test_the_gripper_steps_at_waypoints_only(takes):
    closed = []
    for take in takes:
        gripper, phases = take.trajectory.hand.gripper, np.array(take.trajectory.phases)
        assert set(gripper) <= {0.0, 1.0}
        assert gripper[0] == 0.0
        changes = np.flatnonzero(np.diff(gripper)) + 1
        assert (phases[changes] != phases[changes - 1]).all()
        closed.append(gripper.mean())
    assert 0.1 < np.mean(closed) < 0.3


@pytest.mark.parametrize(("toggle", "states"), [(0.0, [0, 0, 0, 0]), (1.0, [0, 1, 0, 1])])
def test_the_chance_to_step_is_an_option(walks, toggle, states):
    for take in walks(count=10, toggle=toggle):
        assert take.trajectory.hand.gripper[WAYPOINTS[:4]].tolist() == states
        before = np.array(WAYPOINTS[1:4]) - 1
        assert take.trajectory.hand.gripper[before].tolist() == states[:3]


@pytest.mark.parametrize(("legs", "steps"), [(1, 2), (1, 40), (3, 4), (4, 5), (4, 300), (7, 50)])
def test_every_leg_is_a_phase_of_as_many_steps(takes, legs, steps):
    phases = plan(takes[0].scene, steps=steps, legs=legs).phases
    counts = [phases.count(f"leg-{leg + 1}") for leg in range(legs)]
    assert list(phases) == sorted(phases)
    assert sum(counts) == steps
    assert max(counts) - min(counts) <= 2


@pytest.mark.parametrize("legs", [1, 4, 9])
def test_too_few_steps_are_refused_with_the_number_that_would_do(takes, legs):
    with pytest.raises(ConfigError, match=rf"random-walk.*{legs} steps are too few.*needs {legs + 1}"):
        plan(takes[0].scene, steps=legs, legs=legs)
    assert np.isfinite(positions(plan(takes[0].scene, steps=legs + 1, legs=legs))).all()


@pytest.mark.parametrize(
    "options",
    [
        {"legs": 0},
        {"leg": (0.0, 0.1)},
        {"leg": (0.2, 0.1)},
        {"turn": -1.0},
        {"height": (0.0, 0.1)},
        {"tilt": 181.0},
        {"toggle": 1.5},
        {"speed": 1.0},
    ],
)
def test_options_out_of_range_are_refused_by_name(options):
    (name,) = options
    with pytest.raises(ConfigError, match=f"option '{name}"):
        plugins().build("motion", Choice(name="random-walk", options=options))


def test_a_workspace_of_one_point_is_a_walk_that_ends_there(walks):
    here = {"reach": 0.0, "height": (0.1, 0.1), "leg": (1.0, 1.0), "tilt": 0.0, "heading_spread": 0.0}
    for walk in walks(count=10, **here, turn=0.0):
        assert np.isfinite(walk.trajectory.hand.transforms_hand_to_world).all()
        np.testing.assert_allclose(positions(walk.trajectory)[10:, :2], 0.0, atol=1e-12)
