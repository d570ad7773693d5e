"""Opposite directions, pushes that go nowhere, hands straight above: never a NaN, always a rotation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from laws import LAWS, always, grasping, pushing
from motion_material import MOTIONS, PRIMITIVES, ROOT_SEED, stage
from scipy.spatial.transform import Rotation

from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.se3 import make_transform
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.scene.config import HandConfig, MarkerConfig, SceneConfig
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import stage_episode

STEPS = 40
SEEDS = st.integers(0, 2**32 - 1)
NOT_FROM_STRAIGHT_ABOVE = {
    grasping.forward_follows_the_papers_slerp_and_nothing_twists,  # divides by the sine of an angle that is 0
    grasping.the_hand_is_never_inside_the_object,  # on its way to the side of a disc it may graze the rim
}
OFF = st.one_of(st.just(0.0), st.floats(-16.0, -2.0).map(lambda power: 10.0**power))
"""Radians away from the degenerate case."""


def staged(motion, index, scene):
    config = GenerateConfig(fps=STEPS, seconds=1.0, scene=scene)
    return stage_episode(config, CamerasConfig(), ROOT_SEED, Choice(name=motion), index)


def replanned(take, motion, rotation):
    """The same episode from another orientation of the hand at the start."""
    pose = make_transform(rotation, take.scene.hand.position)
    hands = {"hand": replace(take.scene.hand, transform_hand_to_world=pose)}
    scene = replace(take.scene, hands=hands)
    plan = plugins().build("motion", Choice(name=motion)).plan(scene, STEPS, np.random.default_rng(0))
    return replace(take, scene=scene, trajectory=plan)


def across(direction, rng):
    axis = np.cross(direction, rng.normal(size=3))
    return axis / np.linalg.norm(axis)


def frame_along(forward, rng):
    right = across(forward, rng)
    return np.column_stack([right, np.cross(forward, right), forward])


def turns(frames):
    return Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]).magnitude()


@settings(max_examples=100, deadline=None)
@given(SEEDS, OFF, st.sampled_from(["pick", "place"]))
def test_a_hand_that_looks_the_opposite_way_turns_to_the_object_at_a_constant_rate(seed, off, motion):
    rng = np.random.default_rng(seed)
    take = stage(motion, seed % 70)
    grasp = take.trajectory.hand.transforms_hand_to_world[take.trajectory.phases.index("grasp"), :3, 2]
    away = Rotation.from_rotvec(off * across(grasp, rng)).apply(-grasp)
    take = replanned(take, motion, frame_along(away, rng))
    last = take.trajectory.phases.index("grasp")
    frames = take.trajectory.hand.transforms_hand_to_world[: last + 1, :3, :3]
    always.hand_frames_are_right_handed_rotations(take)
    np.testing.assert_allclose(frames[-1, :, 2], grasp, atol=2e-9)
    np.testing.assert_allclose(turns(frames), (np.pi - off) / last, atol=1e-8)


@settings(max_examples=100, deadline=None)
@given(SEEDS, OFF)
def test_a_push_that_needs_half_a_turn_takes_it_at_a_constant_rate(seed, off):
    rng = np.random.default_rng(seed)
    take = stage("push", seed % 70)
    start = take.scene.hand.transform_hand_to_world[:3, :3]
    pushing_pose = pushing.push_poses(replanned(take, "push", start))[0, :3, :3]
    axis = rng.normal(size=3)
    half_a_turn = Rotation.from_rotvec((np.pi - off) * axis / np.linalg.norm(axis)).as_matrix()
    plan = replanned(take, "push", half_a_turn @ pushing_pose)
    always.hand_frames_are_right_handed_rotations(plan)
    frames = plan.trajectory.hand.transforms_hand_to_world[:20, :3, :3]
    np.testing.assert_allclose(frames[-1], pushing_pose, atol=1e-9)
    np.testing.assert_allclose(turns(frames), (np.pi - off) / 19, atol=1e-7)


@pytest.mark.parametrize("distance", [0.0, 1e-300, 1e-12, 2e-9, 1e-6])
def test_a_push_of_hardly_any_distance_has_a_unit_direction(distance):
    scene = SceneConfig(marker=MarkerConfig(distance=(distance, distance)))
    for index in range(30):
        take = staged("push", index, scene)
        always.hand_frames_are_right_handed_rotations(take)
        always.poses_hold_continuous_unit_quaternions_from_the_reference_on(take)
        always.the_object_waits_and_then_moves_with_the_hand(take)
        always.the_hand_is_outside_the_object_from_contact_on(take)
        forward = pushing.push_poses(take)[:, :3, 2]
        np.testing.assert_allclose(np.linalg.norm(forward, axis=1), 1.0, atol=1e-12)
        np.testing.assert_array_equal(forward[:, 2], 0.0)
        np.testing.assert_allclose(
            np.linalg.norm(np.diff(take.trajectory.transforms_object_to_world[[0, -1], :3, 3], axis=0)),
            distance,
            atol=1e-16 + 1e-9 * distance,
        )


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_hand_straight_above_the_object_that_looks_straight_down_keeps_every_law(motion):
    scene = SceneConfig(hand=HandConfig(offset=0.0, aim=0.0))
    primitives = set()
    for index in range(60):
        take = staged(motion, index, scene)
        np.testing.assert_allclose(
            take.scene.hand.transform_hand_to_world[:3, 2], [0.0, 0.0, -1.0], atol=1e-12
        )
        primitives.add(take.primitive.name)
        for law in LAWS[motion]:
            if law not in NOT_FROM_STRAIGHT_ABOVE:
                law(take)
    assert primitives == set(PRIMITIVES)
