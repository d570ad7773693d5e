"""Laws of scenes of several objects, and of the motions that relate them."""

from dataclasses import replace

import numpy as np
import pytest
from geoprior_multiobject import pick_among, stack
from geoprior_multiobject.stack import StackConfig
from scipy.optimize import linprog

from geoprior.errors import ConfigError
from geoprior.geometry.camera import CamerasConfig
from geoprior.geometry.projection import in_view
from geoprior.geometry.se3 import apply, invert
from geoprior.hooks.manager import plugins
from geoprior.motions.trajectory import ways_of_objects
from geoprior.options import Choice
from geoprior.render import rig
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import Studio

EPISODES = range(25)
STACK, PICK = Choice(name="stack"), Choice(name="pick-among")
UNIT_CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-1.0, 0.0)])
BOTH = pytest.mark.parametrize("motion", [STACK, PICK], ids=["stack", "pick-among"])


@pytest.fixture(scope="module", autouse=True)
def _registered():
    """The motions, where the package is on the path and not installed."""
    for name, module in (("stack", stack), ("pick-among", pick_among)):
        if name not in plugins().names("motion"):
            plugins().register(module, name=name, package="geoprior-multiobject", version="0")


@pytest.fixture(scope="module")
def takes(_registered):
    made = Studio(GenerateConfig(motions=[STACK, PICK], fps=6), CamerasConfig(height=64, width=64), 5)
    return {motion.name: [made.stage(motion, index) for index in EPISODES] for motion in (STACK, PICK)}


def half_spaces(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, np.sum(normals * a, axis=1)


def depth(mesh, vertices):
    """Radius of the largest ball in a convex mesh and in the hull of vertices (V, 3); at most 0 if apart.

    A point of the hull is a mean of vertices with weights; how deep it lies in the mesh is linear in them.
    """
    normals, offsets = half_spaces(mesh)
    if (vertices @ normals.T > offsets).all(axis=0).any():
        return 0.0
    depths = offsets[:, None] - normals @ vertices.T
    solved = linprog(
        np.append(np.zeros(len(vertices)), -1.0),
        A_ub=np.column_stack([-depths, np.ones(len(depths))]),
        b_ub=np.zeros(len(depths)),
        A_eq=np.append(np.ones(len(vertices)), 0.0)[None],
        b_eq=[1.0],
        bounds=[(0.0, None)] * len(vertices) + [(None, None)],
    )
    assert solved.success, solved.message
    return solved.x[-1]


@BOTH
def test_objects_stand_on_the_floor_clear_of_each_other_and_the_third_view_has_all(takes, motion):
    for take in takes[motion.name]:
        scene = take.scene
        objects = list(scene.objects.values())
        assert len(objects) == {"stack": 2, "pick-among": 3}[motion.name]
        for number, one in enumerate(objects):
            assert one.vertices[:, 2].min() == pytest.approx(scene.floor.height)
            assert np.abs(one.vertices[:, :2]).max() <= 0.5 * scene.floor.side
            assert in_view(scene.third_view, one.vertices, 0.02)
            for other in objects[:number]:
                apart = np.linalg.norm((one.centre - other.centre)[:2])
                assert apart >= one.radius + other.radius + 0.06 - 1e-9
        assert in_view(scene.hand.view, scene.object.vertices, 0.02)


@BOTH
def test_the_hand_begins_where_the_scene_has_it_and_goes_through_nothing(takes, motion):
    for take in takes[motion.name][:12]:
        scene, way = take.scene, take.trajectory.hand.transforms_hand_to_world
        np.testing.assert_allclose(way[0], scene.hand.transform_hand_to_world)
        for name, each in ways_of_objects(scene, take.trajectory).items():
            mesh = scene.objects[name].mesh
            for hand, thing in zip(way, np.broadcast_to(each, way.shape), strict=True):
                assert depth(mesh, apply(invert(thing) @ hand, scene.hand.cube * UNIT_CUBE)) < 1e-9
        assert way[:, 2, 3].min() > scene.floor.height
        over = np.array(take.trajectory.phases) == "approach"
        top = max(each.vertices[:, 2].max() for each in scene.objects.values())
        assert way[over, 2, 3].min() >= top + 0.03 - 1e-9


@BOTH
def test_the_hand_points_at_the_object_that_is_meant_more_than_at_any_other(takes, motion):
    for take in takes[motion.name]:
        hand = take.scene.hand
        forward = hand.transform_hand_to_world[:3, 2]
        beside = {
            name: np.linalg.norm(np.cross(forward, each.centre - hand.position))
            for name, each in take.scene.objects.items()
        }
        assert beside["object"] <= 0.05 + 1e-9
        assert min(beside, key=beside.get) == "object"


@BOTH
def test_every_object_is_drawn_in_every_view_and_told_in_the_header(motion):
    made = Studio(GenerateConfig(motions=[motion], fps=6), CamerasConfig(height=64, width=64), 5)
    take, episode = made.stage(motion, 0), made.episode(motion, 0)
    episode.validate()
    for shot in take.shots.values():
        bodies = [cloud.body for cloud in shot.clouds]
        assert bodies[: 1 + len(take.scene.objects)] == ["floor", *take.scene.objects]
    assert list(episode.header.details["others"]) == list(take.scene.others)
    for name, told in episode.header.details["others"].items():
        np.testing.assert_allclose(told["position"], take.scene.others[name].centre)
        assert told["primitive"]["name"] == take.others[name].name
    without = take.shots[rig.THIRD]
    fewer = [cloud for cloud in without.clouds if cloud.body not in take.scene.others]
    assert not np.array_equal(
        made.renderer.render(replace(without, clouds=tuple(fewer))),
        made.renderer.render(without),
    )


def test_the_stacked_object_stands_upright_on_the_middle_of_the_base(takes):
    for take in takes["stack"]:
        base, held = take.scene.others["base"], take.trajectory.transforms_object_to_world
        assert take.others["base"].name in stack._FLAT
        assert not take.trajectory.others
        landed = apply(held[-1], take.scene.object.mesh.vertices)
        assert landed[:, 2].min() == pytest.approx(base.vertices[:, 2].max())
        np.testing.assert_allclose(held[-1, :2, 3], base.centre[:2])
        np.testing.assert_allclose(
            held[:, 2, :3], np.broadcast_to([0.0, 0.0, 1.0], (len(held), 3)), atol=1e-12
        )


def test_the_stacked_object_is_held_while_the_gripper_is_closed_and_never_enters_the_base(takes):
    for take in takes["stack"]:
        scene, trajectory = take.scene, take.trajectory
        held, closed = trajectory.transforms_object_to_world, trajectory.hand.gripper > 0.5
        assert (closed[0], closed[-1], closed[-2]) == (False, False, True)
        first = int(np.argmax(closed))
        np.testing.assert_array_equal(held[:first], np.broadcast_to(held[0], held[:first].shape))
        relative = invert(trajectory.hand.transforms_hand_to_world[first:]) @ held[first:]
        np.testing.assert_allclose(relative, np.broadcast_to(relative[0], relative.shape), atol=1e-9)
        base = scene.others["base"]
        for transform in held:
            vertices = apply(transform, scene.object.mesh.vertices)
            assert depth(base.mesh, apply(invert(base.transform_object_to_world), vertices)) < 1e-9


def test_the_picking_hand_ends_above_the_object_pointing_down_and_moves_nothing(takes):
    for take in takes["pick-among"]:
        scene, trajectory = take.scene, take.trajectory
        end = trajectory.hand.transforms_hand_to_world[-1]
        np.testing.assert_allclose(end[:2, 3], scene.object.centre[:2])
        assert 0.005 <= end[2, 3] - scene.object.vertices[:, 2].max() <= 0.02
        np.testing.assert_allclose(end[:3, 2], [0.0, 0.0, -1.0], atol=1e-9)
        assert trajectory.hand.gripper.tolist() == [0.0] * 59 + [1.0]
        for way in ways_of_objects(scene, trajectory).values():
            np.testing.assert_array_equal(way, np.broadcast_to(way.reshape(-1, 4, 4)[0], way.shape))


def test_options_say_how_many_distractors_and_whether_the_object_is_marked():
    options = {"distractors": 1, "marked": True, "distractor": {"primitives": ["sphere"], "gap": 0.1}}
    motion = Choice(name="pick-among", options=options)
    take = Studio(GenerateConfig(motions=[motion]), CamerasConfig(), 5).stage(motion, 0)
    assert {name: choice.name for name, choice in take.others.items()} == {"distractor-1": "sphere"}
    middle = take.trajectory.marker_points.mean(axis=0)
    assert np.linalg.norm((middle - take.scene.object.centre)[:2]) < 0.02


def test_an_episode_is_the_same_alone_and_beside_others():
    def one(*motions):
        made = Studio(GenerateConfig(motions=list(motions)), CamerasConfig(height=32, width=32), 5)
        return made.episode(STACK, 3)

    alone, among = one(STACK), one(PICK, Choice(name="push"), STACK)
    assert alone.header == among.header
    for name, frames in alone.images.items():
        np.testing.assert_array_equal(frames, among.images[name])


@pytest.mark.parametrize(
    ("motion", "seconds", "fault"),
    [
        (STACK, 0.5, "motion 'stack': 5 steps are too few"),
        (PICK, 0.3, "motion 'pick-among': 3 steps are too few"),
        (
            Choice(name="stack", options={"over": 0.7, "down": 0.5}),
            10,
            "motion 'stack': 100 steps are too few",
        ),
        (
            Choice(name="pick-among", options={"distractors": 20}),
            10,
            "a further object, on the floor and clear",
        ),
    ],
)
def test_what_has_no_room_is_refused_in_a_sentence(motion, seconds, fault):
    with pytest.raises(ConfigError, match=fault):
        Studio(GenerateConfig(motions=[motion], seconds=seconds), CamerasConfig(), 0).stage(motion, 0)


def test_the_default_base_has_a_flat_top():
    assert [choice.name for choice in StackConfig().base.primitives] == list(stack._FLAT)
