"""Markers that are larger than what the object covers, and bands with and without walls."""

import numpy as np
import pytest

from geoprior.config import load_config
from geoprior.errors import ConfigError
from geoprior.hooks.manager import plugins
from geoprior.scene.marker import band
from geoprior.synthesis.studio import Studio

SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])


def normals_and_middles(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a), (a + b + c) / 3.0


def test_a_band_covers_the_rim_and_leaves_the_middle():
    flat = band(SQUARE, 0.5, 0.0)
    assert flat.face_areas.sum() == pytest.approx(4.0 - 1.0)
    normals, _ = normals_and_middles(flat)
    assert (normals[:, 2] > 0.0).all(), "it is seen from above"


def test_the_walls_of_a_band_are_seen_from_both_sides():
    walled = band(SQUARE, 0.5, 0.3)
    normals, middles = normals_and_middles(walled)
    upright = np.abs(normals[:, 2]) < 1e-9
    outward = (normals * middles).sum(axis=1)[upright] > 0.0
    inner = np.abs(middles[upright][:, :2]).max(axis=1) < 0.75
    assert upright.sum() == 16
    np.testing.assert_array_equal(outward, ~inner)
    assert walled.vertices[:, 2].max() == pytest.approx(0.3)


def takes(motion, *marker):
    overrides = [f"generate.scene.marker.{each}" for each in marker]
    config = load_config("lite", overrides, plugins())
    studio = Studio(config.generate, config.cameras, 3)
    choice = next(each for each in config.generate.motions if each.name == motion)
    return [studio.stage(choice, index) for index in range(12)]


@pytest.mark.parametrize("motion", ["place", "push"])
def test_a_marker_is_as_large_as_said_and_the_object_ends_in_its_middle(motion):
    for usual, larger in zip(takes(motion), takes(motion, "size=[2, 2]"), strict=True):
        goal = larger.trajectory.transforms_object_to_world[-1, :2, 3]
        reach = np.ptp(larger.trajectory.marker_points[:, :2], axis=0)
        footprint = np.ptp(larger.scene.object.mesh.vertices[:, :2], axis=0).max()
        assert reach.max() > 1.3 * footprint
        assert (
            np.linalg.norm(larger.trajectory.marker_surface.vertices[:, :2].mean(axis=0) - goal) < footprint
        )
        assert np.array_equal(
            usual.trajectory.hand.transforms_hand_to_world[0],
            larger.trajectory.hand.transforms_hand_to_world[0],
        ), "the scene is the same"


def test_only_what_is_set_down_from_above_gets_walls():
    options = ("outline=1", "wall=[0.02, 0.02]", "size=[2, 2]")
    for motion, height in (("place", 0.02), ("push", 0.0)):
        for take in takes(motion, *options):
            above = take.trajectory.marker_surface.vertices[:, 2] - take.scene.floor.height
            assert above.max() == pytest.approx(height, abs=1e-9)
            np.testing.assert_array_equal(take.trajectory.marker_points[:, 2], take.scene.floor.height)


@pytest.mark.parametrize("option", ["size=[2, 1]", "outline=1.5", "band=[0.0, 0.2]", "wall=[-0.1, 0.0]"])
def test_ranges_that_are_none_are_refused(option):
    with pytest.raises(ConfigError, match="marker"):
        load_config("lite", [f"generate.scene.marker.{option}"], plugins())
