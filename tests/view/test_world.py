import numpy as np
import pytest

from geoprior.geometry.projection import project
from geoprior.geometry.se3 import apply, invert
from geoprior.shards.golden import golden_episodes
from geoprior.view.subject import staged_subject
from geoprior.view.world import Bodies, world_of


def test_the_hands_are_where_the_poses_say(push, world):
    [hand] = world.hands
    np.testing.assert_allclose(hand.transforms_hand_to_world[:, :3, 3], push.episode.pose[:, :3])
    np.testing.assert_array_equal(hand.closed, push.episode.pose[:, 7] == 1.0)


def test_a_camera_rides_on_its_hand_or_stands_still(push, world):
    riding, fixed = world.cameras
    assert (riding.name, fixed.name) == ("hand", "third")
    assert fixed.transforms_camera_to_world.shape == (4, 4)
    mounted = np.array(push.episode.header.cameras[0].transform_camera_to_mount)
    for step, transform in enumerate(world.hands[0].transforms_hand_to_world):
        np.testing.assert_allclose(riding.transforms_camera_to_world[step], transform @ mounted)


def test_a_cameras_rays_go_through_its_frames_corners(push, world):
    for header, camera in zip(push.episode.header.cameras, world.cameras, strict=True):
        transform = camera.transforms_camera_to_world
        transform = transform[3] if transform.ndim == 3 else transform
        far = apply(transform, 0.7 * camera.rays)
        pixels, depth = project(far, invert(transform), np.array(header.intrinsics))
        np.testing.assert_allclose(depth, 0.7)
        np.testing.assert_allclose(
            pixels, [[-0.5, -0.5], [31.5, -0.5], [31.5, 31.5], [-0.5, 31.5]], atol=1e-9
        )


def test_the_points_are_those_that_the_third_camera_sees(push, studio):
    bodies = {cloud.body: cloud for cloud in push.bodies.clouds}
    shot = studio.stage(studio.config.motions[2], 1).shots["third"]
    assert list(bodies) == [cloud.body for cloud in shot.clouds] == ["floor", "object", "marker", "hand"]
    for cloud in shot.clouds:
        np.testing.assert_array_equal(bodies[cloud.body].points, cloud.points)


@pytest.mark.parametrize("variant", ["black-images", "no-hand-cube"])
def test_a_variant_blinds_cameras_and_leaves_the_world(push, make_studio, variant):
    blind = staged_subject(make_studio(f"generate.variants=[{variant}]"), "push-000001")
    assert [cloud.body for cloud in blind.bodies.clouds] == [cloud.body for cloud in push.bodies.clouds]
    assert (blind.episode.images["third"] != push.episode.images["third"]).any()


def test_the_surface_moves_with_the_points(push):
    [solid] = push.bodies.solids
    cloud = next(cloud for cloud in push.bodies.clouds if cloud.body == "object")
    np.testing.assert_array_equal(solid.transforms_solid_to_world, cloud.transforms_cloud_to_world)
    slack = 1e-9
    assert (cloud.points >= solid.mesh.vertices.min(axis=0) - slack).all()
    assert (cloud.points <= solid.mesh.vertices.max(axis=0) + slack).all()


def test_a_header_tells_boxes_where_the_bodies_are_not_known(push):
    told = world_of(push.episode.header, push.episode.pose)
    details = push.episode.header.details
    assert told.bodies == Bodies((), ())
    [box] = told.objects
    assert list(box.extents) == details["object"]["extents"]
    assert told.hand_cube == details["hand_cube"]
    assert told.floor.height == details["floor"]["height"]
    assert world_of(push.episode.header, push.episode.pose, push.bodies).objects == ()


FOREIGN = [
    {},
    {"object": None, "floor": None, "hand_cube": None},
    {"object": "box", "floor": [1, 2], "hand_cube": "large"},
    {"object": {"extents": [1, 2]}, "floor": {"side": -1.0}, "hand_cube": -1},
    {"others": ["box"]},
    {"others": {"base": {"extents": [1, 2]}}},
    {"object": {"extents": [1, 1, 1], "position": [0, 0, "nan"]}, "floor": {"side": "nan"}, "hand_cube": [1]},
]


@pytest.mark.parametrize("details", FOREIGN)
def test_details_of_another_form_are_left_out(push, details):
    header = push.episode.header.model_copy(update={"details": details})
    world = world_of(header, push.episode.pose)
    assert world.objects == ()
    assert world.hand_cube == 0.0
    assert (world.floor.side, world.floor.height) == (0.8, 0.0)


@pytest.mark.parametrize("change", [{"mount": "tripod"}, {"intrinsics": [[0.0] * 3] * 3}])
def test_a_camera_that_is_nowhere_is_left_out(push, change):
    hand, third = push.episode.header.cameras
    header = push.episode.header.model_copy(update={"cameras": [hand, third.model_copy(update=change)]})
    assert [camera.name for camera in world_of(header, push.episode.pose).cameras] == ["hand"]


def test_two_hands_are_two_ways():
    episode = next(golden_episodes())
    header = episode.header.model_copy(update={"hands": ["hand", "left"]})
    pose = np.hstack([episode.pose, episode.pose + np.array([0, 1, 0, 0, 0, 0, 0, 0], np.float32)])
    world = world_of(header, pose)
    one, other = (hand.transforms_hand_to_world for hand in world.hands)
    np.testing.assert_allclose(other[:, 1, 3] - one[:, 1, 3], 1.0)
    np.testing.assert_array_equal(one[:, :3, :3], other[:, :3, :3])
