from dataclasses import replace

import numpy as np
import pytest

from geoprior.geometry.projection import project
from geoprior.render.clouds import Cloud
from geoprior.shards.golden import golden_episodes
from geoprior.view.canvas import BACKGROUND, enlarge, to_rgb
from geoprior.view.marks import Dots, Lines
from geoprior.view.orbit import Angle, views_around
from geoprior.view.palette import BODIES, FLOOR, HAND, OBJECT
from geoprior.view.scenery import extent, marks_of
from geoprior.view.space import meanings, space_film, space_picture, space_view
from geoprior.view.world import world_of

SIZE = (150, 200)
WAYS = {"open": 1, "closed": 3}


def lines_of(marks, colour, width=None):
    return [
        mark
        for mark in marks
        if isinstance(mark, Lines) and mark.colour == colour and width in (None, mark.width)
    ]


def shows(picture, colour):
    """How many pixels come near a colour."""
    return int((np.abs(picture.astype(int) - colour).max(axis=-1) < 40).sum())


def test_every_body_is_in_the_picture_in_its_colour(world):
    picture = space_view(world, Angle())
    for body, colour in BODIES.items():
        assert shows(picture, colour) > 20, body
    without_marker = tuple(cloud for cloud in world.bodies.clouds if cloud.body != "marker")
    other = replace(world, bodies=replace(world.bodies, clouds=without_marker))
    assert shows(space_view(other, Angle()), BODIES["marker"]) == 0


def test_the_legend_names_what_is_there(world, push):
    assert list(meanings(world)) == ["floor", "object", "marker", "hand", "cameras", "right", "up", "forward"]
    told = world_of(push.episode.header, push.episode.pose)
    assert list(meanings(told))[:3] == ["floor", "object's box", "hand"]


def test_the_points_of_the_picture_are_where_the_third_camera_sees_them(push, world):
    """Seen from the third camera's own place, a dot lies on the pixel of the binary frame that it lights."""
    header = push.episode.header.cameras[1]
    for step in (0, 7):
        dots = [mark for mark in marks_of(world, step) if isinstance(mark, Dots)]
        inverse = np.linalg.inv(np.array(header.transform_camera_to_mount))
        pixels, _ = project(
            np.concatenate([mark.points for mark in dots]), inverse, np.array(header.intrinsics)
        )
        columns, rows = np.round(pixels).astype(int).T
        inside = (columns >= 0) & (columns < header.width) & (rows >= 0) & (rows < header.height)
        assert inside.sum() > 300
        assert (push.episode.images["third"][step][rows[inside], columns[inside]] == 255).all()


def test_the_way_goes_through_the_hands_positions_and_is_thick_while_the_gripper_is_closed(place):
    pose = place.episode.pose
    world = world_of(place.episode.header, pose, place.bodies)
    marks = list(marks_of(world, world.steps - 1))
    ends = {
        name: np.concatenate(
            [line.segments[:, 1] for line in lines_of(marks, HAND, width) if len(line.segments)]
        )
        for name, width in WAYS.items()
        if name == "closed"
    }
    np.testing.assert_allclose(ends["closed"], pose[pose[:, 7] == 1.0, :3], atol=1e-6)
    thin = [line for line in lines_of(marks, HAND, 1) if line.segments.shape[0] and line.strength == 1.0]
    drawn = np.concatenate([line.segments[:, 1] for line in thin])
    for position in pose[1:][pose[1:, 7] == 0.0, :3]:
        assert np.linalg.norm(drawn - position, axis=1).min() < 1e-6


def test_a_whole_turn_gives_the_same_picture_and_another_angle_another_one(push, world):
    usual = space_picture(push.episode, world, Angle(20, 15), size=SIZE)
    np.testing.assert_array_equal(usual, space_picture(push.episode, world, Angle(380, 15), size=SIZE))
    for angle in (Angle(30, 15), Angle(20, 25), Angle(200, 15), Angle(20, -15)):
        assert (space_picture(push.episode, world, angle, size=SIZE) != usual).any()


@pytest.mark.parametrize("angle", [Angle(0, 90), Angle(0, -90), Angle(123, 0), Angle(-500, 45)])
def test_every_angle_can_be_drawn(world, angle):
    assert (space_view(world, angle, size=SIZE) != BACKGROUND).any()


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("subject", ["push", "place"])
def test_the_hand_and_the_object_stay_in_the_picture_and_when_wide_everything_does(request, subject, wide):
    subject = request.getfixturevalue(subject)
    world = world_of(subject.episode.header, subject.episode.pose, subject.bodies)
    view = views_around(extent(world, wide=wide), [Angle()], SIZE)[0]
    clouds = [cloud for cloud in world.bodies.clouds if wide or cloud.body != "floor"]
    for step in range(world.steps):
        dots = [mark for mark in marks_of(world, step) if isinstance(mark, Dots)]
        moving = [mark for mark in dots if wide or mark.colour != FLOOR]
        assert len(moving) >= len(clouds)
        places = [mark.points for mark in moving]
        places += [camera.transforms_camera_to_world[None, :3, 3] for camera in world.cameras[1:] if wide]
        pixels, _ = project(np.concatenate(places), view.transforms_world_to_camera, view.intrinsics)
        assert (pixels > -0.5).all()
        assert (pixels < [SIZE[1] - 0.5, SIZE[0] - 0.5]).all()


def test_what_leaves_and_comes_back_stays_in_the_picture(world):
    there_and_back = np.repeat(np.eye(4)[None], world.steps, axis=0)
    there_and_back[3:5, 2, 3] = 1.5
    kite = Cloud("kite", np.zeros((1, 3)), there_and_back)
    flown = replace(world, bodies=replace(world.bodies, clouds=(*world.bodies.clouds, kite)))
    assert extent(flown)[:, 2].max() == pytest.approx(1.5)


def test_a_film_shows_every_step_with_what_each_camera_sees(push, world):
    film = list(space_film(push.episode, world, Angle(), size=SIZE))
    assert len(film) == world.steps
    assert len({frame.shape for frame in film}) == 1
    for step, frame in enumerate(film):
        for name, top in (("hand", 8 + 18), ("third", 8 + 18 + 32 + 4 + 18)):
            seen = enlarge(to_rgb(push.episode.images[name][step]), 1)
            np.testing.assert_array_equal(frame[top : top + 32, 212 : 212 + 32], seen)
    assert len({frame[: SIZE[0], : SIZE[1]].tobytes() for frame in film}) == world.steps


def test_an_orbit_goes_round_while_the_film_runs(push, world):
    def film(orbit):
        return list(space_film(push.episode, world, Angle(), orbit, size=SIZE))

    once, thrice = film(360.0), film(3 * 360.0)  # eight steps: both stop at the same eight sides, in turn
    for step in (0, 4):
        np.testing.assert_array_equal(once[step], thrice[step])
    for step in (1, 2, 3):
        assert (once[step] != thrice[step]).any()


def test_a_demonstration_without_points_is_drawn_with_its_way_cameras_and_table(push, bare_header):
    episode = replace(push.episode, header=bare_header)
    world = world_of(bare_header, episode.pose)
    picture = space_picture(episode, world, Angle(), size=(480, 640))
    assert shows(picture, HAND) > 50
    assert shows(picture, OBJECT) == 0
    squares = [mark for mark in marks_of(world, 0) if isinstance(mark, Lines) and mark.colour == FLOOR]
    assert squares[0].segments[..., 2].tolist() == [[0.0, 0.0]] * 18
    assert len(list(space_film(episode, world, Angle(), size=SIZE))) == world.steps


def test_boxes_stand_for_bodies_that_only_the_header_tells(push):
    world = world_of(push.episode.header, push.episode.pose)
    told = push.episode.header.details["object"]
    start, end = lines_of(marks_of(world, 0), OBJECT)
    for box, place in ((start, told["position"]), (end, told["final_position"])):
        corners = np.unique(box.segments.reshape(-1, 3).round(9), axis=0)
        assert len(corners) == 8
        np.testing.assert_allclose(corners.mean(axis=0), place, atol=1e-6)
    assert start.strength > end.strength
    start, end = lines_of(marks_of(world, world.steps - 1), OBJECT)
    assert start.strength < end.strength


def test_any_episode_can_be_drawn_even_of_one_step():
    for episode in golden_episodes():
        one = episode.header.model_copy(update={"steps": 1})
        images = {name: frames[:1] for name, frames in episode.images.items()}
        single = replace(episode, header=one, pose=episode.pose[:1], images=images)
        for each in (episode, single):
            world = world_of(each.header, each.pose)
            space_picture(each, world, Angle(), size=SIZE)
            assert len(list(space_film(each, world, Angle(), 90.0, size=SIZE))) == each.header.steps
