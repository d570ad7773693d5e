"""Whole episodes, pixel for pixel against the slow reference: every motion, size and kind of point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from render_material import (
    HAND_FOV,
    THIRD_FOV,
    hand_camera,
    moved,
    packed_frames,
    reference_frame,
    reference_frames,
    third_camera,
    unpacked_frames,
)

from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.se3 import make_transform
from geoprior.motions.trajectory import Trajectory, way_of_hand
from geoprior.options import Choice
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import stage_episode

MOTIONS = ("pick", "place", "push")
PRIMITIVES = ("cone", "cylinder", "prism", "pyramid", "sphere", "truncated-cone", "truncated-pyramid")
SIZES = [(96, 96), (97, 101), (128, 128), (101, 64), (33, 65), (64, 127), (16, 16)]
NOWHERE = np.zeros((0, 3))
EDGE = 1e-6
"""Pixels from where a point's footprint jumps."""


def stage(motion, index, size, steps):
    primitive = Choice(name=PRIMITIVES[index % len(PRIMITIVES)])
    config = GenerateConfig(fps=steps, seconds=1.0, primitives=[primitive])
    cameras = CamerasConfig(height=size[0], width=size[1])
    return stage_episode(config, cameras, 23, Choice(name=motion), index)


def assert_identical(scene, trajectory, footprint=2):
    frames = unpacked_frames(scene, trajectory, footprint)
    packed = packed_frames(scene, trajectory, footprint)
    expected = reference_frames(scene, trajectory, footprint)
    assert sorted(frames) == sorted(expected)
    for name, views in expected.items():
        assert frames[name].dtype == np.uint8
        np.testing.assert_array_equal(frames[name], views, err_msg=name)
        np.testing.assert_array_equal(packed[name], np.packbits(views, axis=-1), err_msg=name)
    return frames


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("motion", MOTIONS)
def test_every_frame_of_both_cameras(motion, size):
    for index in range(len(PRIMITIVES)):
        take = stage(motion, index, size, steps=5)
        frames = assert_identical(take.scene, take.trajectory)
        for views in frames.values():
            assert views.shape == (5, *size)
            assert 0.01 < np.mean(views > 0) < 0.99, "the test must be able to fail"


@pytest.mark.parametrize("motion", MOTIONS)
def test_every_frame_at_the_papers_size(motion):
    for index in range(2):
        take = stage(motion, index, (480, 640), steps=6)
        assert_identical(take.scene, take.trajectory)


@pytest.mark.slow
@pytest.mark.parametrize("size", [*SIZES, (480, 640), (120, 160)])
@pytest.mark.parametrize("motion", MOTIONS)
def test_every_frame_over_hundreds_of_episodes(motion, size):
    for index in range(20 * len(PRIMITIVES)):
        take = stage(motion, index, size, steps=20)
        assert_identical(take.scene, take.trajectory)


@pytest.mark.parametrize("footprint", [1, 2, 3, 4, 7, 16])
def test_every_footprint(footprint):
    for motion in MOTIONS:
        take = stage(motion, footprint, (70, 67), steps=5)
        assert_identical(take.scene, take.trajectory, footprint)


@pytest.mark.parametrize("motion", ["place", "push"])
def test_with_and_without_the_marker(motion):
    for index in range(len(PRIMITIVES)):
        take = stage(motion, index, (97, 101), steps=6)
        with_marker = assert_identical(take.scene, take.trajectory)
        without = assert_identical(take.scene, replace(take.trajectory, marker_points=None))
        assert np.all(with_marker["third"] >= without["third"])
        assert np.any(with_marker["third"][0] > without["third"][0]), "it is in the first frame"
        assert np.all(with_marker["hand"] >= without["hand"])
        assert np.any(with_marker["hand"] > without["hand"])


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_hand_is_in_the_third_view_only(motion):
    for index in range(3 * len(PRIMITIVES)):
        take = stage(motion, index, (96, 96), steps=8)
        frames = unpacked_frames(take.scene, take.trajectory)
        handless = replace(take.scene, hands={"hand": replace(take.scene.hand, points=NOWHERE)})
        without = unpacked_frames(handless, take.trajectory)
        np.testing.assert_array_equal(frames["hand"], without["hand"])
        assert np.all(frames["third"] >= without["third"])
        cube = moved(take.scene.hand.points, take.trajectory.hand.transforms_hand_to_world[0])
        drawn = reference_frame(cube, *third_camera(take.scene.third_view), THIRD_FOV, (96, 96))
        np.testing.assert_array_equal(frames["third"][0], np.maximum(without["third"][0], drawn))
        assert np.sum(drawn > without["third"][0]) > 20, "the whole cube is in the first frame"


def one_point_a_frame(scene, points):
    """Nothing but one point that jumps from step to step, before the two cameras of a scene at its start."""
    hand, steps = scene.hand.transform_hand_to_world, len(points)
    return replace(
        scene,
        floor=replace(scene.floor, points=NOWHERE),
        object=replace(scene.object, points=np.zeros((1, 3))),
        hands={"hand": replace(scene.hand, points=NOWHERE)},
    ), Trajectory(
        hands=way_of_hand(np.repeat(hand[None], steps, axis=0), np.zeros(steps)),
        transforms_object_to_world=make_transform(np.eye(3), points),
        marker_points=None,
        phases=("approach",) * steps,
    )


def awkward_pixels(count, footprint, inner=frozenset()):
    """Coordinates just before and after the jumps near both ends of ``count`` pixels, and some inside."""
    near = inner | {-footprint - 1, -footprint, -1, 0, 1, count - 2, count - 1, count}
    jumps = np.array(sorted(near)) - 1.0 + 0.5 * footprint
    return np.concatenate([jumps - EDGE, jumps + EDGE])


def seen_from(position, axes, fov, size, rows, columns, depths):
    """World points that project to given pixels at given depths, of one camera."""
    focal = size[0] / 2 / np.tan(np.radians(fov) / 2)
    x = (columns - (size[1] - 1) / 2) / focal * depths
    y = (rows - (size[0] - 1) / 2) / focal * depths
    return position + np.column_stack([x, y, depths]) @ axes.T


@pytest.mark.parametrize("footprint", [1, 2, 3, 16])
@pytest.mark.parametrize("size", [(17, 16), (97, 101), (40, 63), (40, 64), (40, 65), (16, 128)])
def test_single_points_at_every_edge_and_corner_and_word_of_a_frame(size, footprint):
    take = stage("pick", 1, size, steps=3)
    rows = awkward_pixels(size[0], footprint)
    columns = awkward_pixels(size[1], footprint, inner={7, 8, 62, 63, 64, 65})
    rows, columns = (axis.ravel() for axis in np.meshgrid(rows, columns))
    depths = np.random.default_rng(0).uniform(0.02, 3.0, len(rows))
    third, hand = third_camera(take.scene.third_view), hand_camera(take.scene.hand.transform_hand_to_world)
    for name, camera, fov in (("third", third, THIRD_FOV), ("hand", hand, HAND_FOV)):
        points = seen_from(*camera, fov, size, rows, columns, depths)
        frames = assert_identical(*one_point_a_frame(take.scene, points), footprint)
        lit = np.count_nonzero(frames[name], axis=(1, 2))
        assert {0, 1, footprint**2} <= set(lit), "outside, all but a pixel cut off, and whole"


@pytest.mark.parametrize("depth", [-3.0, -0.5, -0.01, -1e-9, 0.0, 1e-9, 0.01 - 1e-9, 0.01 + 1e-9, 0.5, 50.0])
def test_points_behind_and_too_near_are_not_drawn(depth):
    size = (40, 65)
    take = stage("pick", 2, size, steps=3)
    rng = np.random.default_rng(1)
    rows, columns = rng.uniform(0.0, size[0] - 1.0, 60), rng.uniform(0.0, size[1] - 1.0, 60)
    camera = third_camera(take.scene.third_view)
    points = seen_from(*camera, THIRD_FOV, size, rows, columns, np.full(60, depth))
    frames = assert_identical(*one_point_a_frame(take.scene, points))
    assert np.all(np.any(frames["third"], axis=(1, 2)) == (depth > 0.01))
