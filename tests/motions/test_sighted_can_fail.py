"""Every law of the config `sighted` refuses an episode that breaks it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from laws import sighted
from laws.sighted import SIGHTED

from geoprior.config import load_config
from geoprior.hooks.manager import plugins
from geoprior.motions.trajectory import HandWay
from geoprior.synthesis.studio import Studio

TINY = 2e-6


@cache
def takes(motion):
    config = load_config("sighted", ["generate.scene.distractors.count=[2,2]"], plugins())
    studio = Studio(config.generate, config.cameras, 3)
    choice = next(each for each in config.generate.motions if each.name == motion)
    return [studio.stage(choice, index) for index in range(4)]


def bodies(take, name, *by):
    """The take whose third-person camera sees the bodies of a name elsewhere; None for by: not at all."""
    shot = take.shots["third"]
    shift = np.zeros((4, 4))
    shift[:3, 3] = by or 0.0
    clouds = tuple(
        replace(cloud, transforms_cloud_to_world=cloud.transforms_cloud_to_world + shift)
        if cloud.body == name
        else cloud
        for cloud in shot.clouds
        if by or cloud.body != name
    )
    return replace(take, shots={**take.shots, "third": replace(shot, clouds=clouds)})


def way(take, **changes):
    hand = replace(take.trajectory.hand, **changes)
    return replace(take, trajectory=replace(take.trajectory, hands={"hand": hand}))


def solid(take, steps, *by):
    moved = take.trajectory.transforms_object_to_world.copy()
    moved[steps, :3, 3] += by
    return replace(take, trajectory=replace(take.trajectory, transforms_object_to_world=moved))


def into_the_middle(take, body):
    """One of the bodies brought to the object's centre."""
    shot = take.shots["third"]
    at = take.trajectory.transforms_object_to_world.copy()
    found = next(cloud for cloud in shot.clouds if cloud.body == body)
    at[:, :3, 3] -= np.mean([found.surface.vertices.min(axis=0), found.surface.vertices.max(axis=0)], axis=0)
    clouds = tuple(
        replace(cloud, transforms_cloud_to_world=at) if cloud is found else cloud for cloud in shot.clouds
    )
    return replace(take, shots={**take.shots, "third": replace(shot, clouds=clouds)})


def flipped(take):
    poses = take.trajectory.hand.transforms_hand_to_world.copy()
    poses[5, :3, :3] = poses[5, :3, :3] @ np.diag([-1.0, 1.0, -1.0])
    return way(take, transforms_hand_to_world=poses)


def out_of_view(take):
    far = replace(
        take.scene.object,
        transform_object_to_world=take.scene.object.transform_object_to_world + np.eye(4, k=3) * 3.0,
    )
    return replace(take, scene=replace(take.scene, object=far))


def grip(take, value):
    return way(take, grip=value)


def gripper(take, steps, value):
    changed: HandWay = take.trajectory.hand
    values = changed.gripper.copy()
    values[steps] = value
    return way(take, gripper=values)


def marker(take, *by):
    points = take.trajectory.marker_points + np.array(by)
    return replace(take, trajectory=replace(take.trajectory, marker_points=points))


BREAKS = {
    sighted.the_object_ends_within_its_marker: lambda t: solid(t, -1, 0.3, 0.0, 0.0),
    sighted.the_hand_has_a_cube_and_two_fingers: lambda t: bodies(t, "finger"),
    sighted.nothing_of_the_hand_goes_below_the_floor: lambda t: bodies(t, "finger", 0.0, 0.0, -0.1),
    sighted.nothing_of_the_arm_goes_below_the_floor_or_into_the_object: lambda t: into_the_middle(t, "arm"),
    sighted.distractors_lie_apart_from_all_that_happens: lambda t: into_the_middle(t, "distractor"),
    sighted.no_point_of_the_object_is_inside_the_hand: lambda t: into_the_middle(t, "finger"),
    sighted.both_first_frames_have_the_object: out_of_view,
    sighted.the_object_never_jumps_or_turns_but_with_the_hand: lambda t: solid(t, -3, 0.2, 0.0, 0.0),
    sighted.the_quaternions_are_continuous: flipped,
    sighted.the_fingers_close_while_the_hand_waits: lambda t: way(t, openness=None),
    sighted.the_object_lies_between_the_fingers: lambda t: grip(t, 0.2),
    sighted.the_lifted_object_is_up_and_the_gripper_closed: lambda t: solid(t, -1, 0.0, 0.0, 0.1),
    sighted.the_open_hand_rises_from_the_placed_object: lambda t: solid(t, -1, 0.0, 0.0, TINY),
    sighted.the_closed_hand_stays_behind_the_object_and_ends_with_it: lambda t: gripper(t, -1, 0.0),
    sighted.the_marker_lies_flat_on_the_floor_and_in_the_third_view: lambda t: marker(t, 0.0, 0.0, TINY),
}
EACH = [
    pytest.param(motion, law, id=f"{motion}-{law.__name__}")
    for motion, laws in SIGHTED.items()
    for law in laws
    if law in BREAKS
]


@pytest.mark.parametrize(("motion", "law"), EACH)
def test_a_broken_episode_breaks_its_law(motion, law):
    broken = 0
    for take in takes(motion):
        law(take)
        if law is sighted.distractors_lie_apart_from_all_that_happens and not take.scene.distractors:
            continue
        with pytest.raises(AssertionError):
            law(BREAKS[law](take))
        broken += 1
    assert broken


def test_every_law_of_its_own_is_broken_above():
    own = {law for laws in SIGHTED.values() for law in laws if law.__module__ == sighted.__name__}
    assert own == set(BREAKS)
