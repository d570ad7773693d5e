"""What holds at every step of every motion."""

from __future__ import annotations

import numpy as np
import pytest

from geoprior.errors import ConfigError
from geoprior.geometry.se3 import apply, invert, pose_vectors
from geoprior.hooks.manager import plugins
from geoprior.options import Choice

MOTIONS = ("pick", "place", "push")
FEWEST = {"pick": 2, "place": 3, "push": 3}


def runs(phases):
    return [name for i, name in enumerate(phases) if i == 0 or phases[i - 1] != name]


@pytest.mark.parametrize("motion", MOTIONS)
def test_hand_frames_are_right_handed_rotations(takes, motion):
    for take in takes(motion):
        frames = take.trajectory.transforms_hand_to_world[:, :3, :3]
        identity = np.broadcast_to(np.eye(3), frames.shape)
        np.testing.assert_allclose(np.swapaxes(frames, 1, 2) @ frames, identity, atol=1e-9)
        right, up, forward = np.moveaxis(frames, 2, 0)
        np.testing.assert_allclose(np.cross(up, forward), right, atol=1e-9)


@pytest.mark.parametrize("motion", MOTIONS)
def test_quaternions_are_unit_and_continuous(takes, motion):
    for take in takes(motion):
        poses = pose_vectors(take.trajectory.transforms_hand_to_world, take.trajectory.gripper)
        quaternions = poses[:, 3:7].astype(np.float64)
        np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-6)
        assert np.linalg.norm(np.diff(quaternions, axis=0), axis=1).max() < 0.2


@pytest.mark.parametrize("motion", MOTIONS)
def test_it_starts_from_the_scene_and_moves_smoothly(takes, motion):
    for take in takes(motion):
        trajectory = take.trajectory
        np.testing.assert_allclose(
            trajectory.transforms_hand_to_world[0], take.scene.hand.transform_hand_to_world, atol=1e-12
        )
        np.testing.assert_array_equal(
            trajectory.transforms_object_to_world[0], take.scene.object.transform_object_to_world
        )
        steps = np.linalg.norm(np.diff(trajectory.transforms_hand_to_world[:, :3, 3], axis=0), axis=1)
        assert steps.max() < 0.06
        assert {
            len(trajectory.gripper),
            len(trajectory.phases),
            len(trajectory.transforms_object_to_world),
        } == {40}


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_object_never_sinks_below_the_floor_nor_tilts(takes, motion):
    for take in takes(motion):
        transforms = take.trajectory.transforms_object_to_world
        lowest = apply(transforms, take.scene.object.mesh.vertices[None])[..., 2].min()
        assert lowest >= take.scene.floor.height - 1e-9
        np.testing.assert_allclose(transforms[:, 2, 2], 1.0, atol=1e-9)


@pytest.mark.parametrize("motion", ["place", "push"])
def test_hand_to_object_is_constant_while_the_object_moves(takes, motion):
    for take in takes(motion):
        trajectory = take.trajectory
        moving = trajectory.phases.index("transport" if motion == "place" else "push")
        relative = invert(trajectory.transforms_hand_to_world) @ trajectory.transforms_object_to_world
        np.testing.assert_allclose(relative[moving - 1 :] - relative[-1], 0.0, atol=1e-6)
        before = trajectory.transforms_object_to_world[:moving]
        np.testing.assert_array_equal(before, np.broadcast_to(before[0], before.shape))


@pytest.mark.parametrize("motion", ["place", "push"])
def test_the_marker_lies_flat_on_the_floor_and_in_the_third_view(takes, motion):
    for take in takes(motion):
        points, scene = take.trajectory.marker_points, take.scene
        np.testing.assert_array_equal(points[:, 2], scene.floor.height)
        assert np.abs(points[:, :2]).max() <= 0.5 * scene.floor.side
        camera = invert(scene.third_view.transforms_world_to_camera)
        local = (points - camera[:3, 3]) @ camera[:3, :3]
        assert np.abs(local[:, :2] / local[:, 2:]).max() <= np.tan(np.radians(25.0))
        moved = take.trajectory.transforms_object_to_world[-1, :3, 3] - scene.object.centre
        assert 0.12 - 1e-9 <= np.linalg.norm(moved) <= 0.25 + 1e-9
        assert abs(moved[2]) < 1e-12


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_fewest_steps_do_and_fewer_are_refused(takes, motion):
    for steps in range(FEWEST[motion], 12):
        assert len(takes(motion, steps=steps, count=2)[0].trajectory.gripper) == steps
    scene = takes(motion)[0].scene
    planner = plugins().build("motion", Choice(name=motion))
    with pytest.raises(ConfigError, match="too few"):
        planner.plan(scene, FEWEST[motion] - 1, np.random.default_rng(0))


@pytest.mark.parametrize("motion", MOTIONS)
def test_planning_does_not_change_the_scene(takes, motion):
    scene = takes(motion)[0].scene
    before = scene.object.transform_object_to_world.copy(), scene.hand.transform_hand_to_world.copy()
    planner = plugins().build("motion", Choice(name=motion))
    planner.plan(scene, 20, np.random.default_rng(0))
    np.testing.assert_array_equal(scene.object.transform_object_to_world, before[0])
    np.testing.assert_array_equal(scene.hand.transform_hand_to_world, before[1])


def test_phases_are_named_in_order_and_shared_by_the_option(takes):
    assert runs(takes("pick")[0].trajectory.phases) == ["approach", "grasp"]
    assert runs(takes("place")[0].trajectory.phases) == ["approach", "grasp", "transport", "release"]
    assert runs(takes("push")[0].trajectory.phases) == ["approach", "push"]
    for motion in ("place", "push"):
        reached = {
            share: takes(motion, count=1, approach=share)[0].trajectory.phases.count("approach")
            for share in (0.25, 0.75)
        }
        assert abs(reached[0.25] - 10) <= 1
        assert abs(reached[0.75] - 30) <= 1
