"""What every look must keep to, and what each of the built-in ones is for."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from geoprior.geometry.se3 import invert
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.sim.looks.distractors import CLEARANCE, SHAPES
from geoprior.sim.workers import Setup, environment

LOOKS = plugins().names("look")
SHIFTS = [name for name in LOOKS if name != "plain"]


@pytest.fixture
def looked_at(ur5e, cameras):
    def make(look: str, task: str = "pick", **options):
        return environment(Setup(ur5e, Choice(name=task), cameras, Choice(name=look, options=options)), 10)

    return make


def _states(env, seed: int) -> np.ndarray:
    env.reset(seed)
    states = [np.concatenate([env._data.qpos, env._data.qvel])]
    for command in islice(env.expert(seed=0), 25):
        env.step(command)
        states.append(np.concatenate([env._data.qpos, env._data.qvel]))
    return np.array(states)


def _frames(env, seed: int) -> np.ndarray:
    env.reset(seed)
    frames = env.render()
    return np.stack([frames["hand"], frames["third"]])


def test_there_are_four_shifts():
    assert {"repainted", "other-light", "moved-camera", "distractors"} <= set(SHIFTS)


@pytest.fixture(scope="module")
def plain(ur5e, cameras):
    """States of an episode, and its first frames."""
    env = environment(Setup(ur5e, Choice(name="pick"), cameras), 10)
    return _states(env, 6), _frames(env, 6)


@pytest.fixture(scope="module", params=SHIFTS)
def shifted(request, plain, ur5e, cameras):
    """Each look in turn, built once."""
    return environment(Setup(ur5e, Choice(name="pick"), cameras, Choice(name=request.param)), 10)


def test_physics_feels_nothing_of_a_look(shifted, plain):
    """Through the grasp of the cube, to the bit."""
    assert np.array_equal(_states(shifted, 6), plain[0])


def test_a_look_changes_the_pictures_and_is_the_seeds(shifted, plain):
    first = _frames(shifted, 6)
    assert (np.abs(first[1].astype(int) - plain[1][1]).max(axis=-1) > 20).mean() > 0.01
    other = _frames(shifted, 7)
    assert not np.array_equal(other, first)
    np.testing.assert_array_equal(_frames(shifted, 6), first)


def test_nothing_of_an_episodes_look_is_left_in_the_next(shifted):
    """Twenty episodes later the lamp is no weaker and the camera no farther away."""
    first = _frames(shifted, 3)
    for seed in range(20):
        shifted.reset(seed)
    np.testing.assert_array_equal(_frames(shifted, 3), first)


@pytest.mark.parametrize("look", ["plain", "moved-camera"])
def test_headers_say_where_the_camera_really_is(looked_at, look):
    env = looked_at(look)
    env.reset(5)
    header = next(each for each in env.camera_headers() if each.name == "third")
    camera = env._model.camera("third").id
    said = np.array(header.transform_camera_to_mount)
    np.testing.assert_allclose(said[:3, 3], env._data.cam_xpos[camera] - [0.0, 0.0, 0.8], atol=1e-9)
    flip = np.diag([1.0, -1.0, -1.0])
    np.testing.assert_allclose(said[:3, :3] @ flip, env._data.cam_xmat[camera].reshape(3, 3), atol=1e-9)


@pytest.mark.parametrize(("distance", "angle"), [(0.04, 3.0), (0.1, 0.0)])
def test_the_camera_is_moved_as_far_as_was_said(looked_at, distance, angle):
    plain = looked_at("plain").world
    world = looked_at("moved-camera", distance=distance, angle=angle)
    world.reset(2)
    between = invert(plain.transform_camera_to_workspace()) @ world.world.transform_camera_to_workspace()
    assert np.linalg.norm(between[:3, 3]) == pytest.approx(distance, abs=1e-9)
    turn = Rotation.from_matrix(between[:3, :3]).magnitude()
    assert np.degrees(turn) == pytest.approx(angle, abs=1e-6)


def test_the_lamp_brightens_and_darkens(looked_at):
    env = looked_at("other-light")
    means = [_frames(env, seed)[1].mean() for seed in range(12)]
    plain = _frames(looked_at("plain"), 0)[1].mean()
    assert min(means) < 0.8 * plain
    assert max(means) > 1.05 * plain


@pytest.mark.parametrize("task", ["pick", "door"])
def test_distractors_stand_apart_from_the_tasks_objects_and_from_each_other(looked_at, task):
    env = looked_at("distractors", task, count=5)
    for seed in range(20):
        env.reset(seed)
        model, data = env._model, env._data
        geoms = [model.geom(f"distractor{number}").id for number in range(len(SHAPES))]
        standing = [geom for geom in geoms if data.geom_xpos[geom, 2] > 0.8]
        assert len(standing) == 5
        objects = [
            geom
            for geom in range(model.ngeom)
            if model.body(model.geom_bodyid[geom]).name.startswith(("cube", "door"))
        ]
        assert objects
        for geom in standing:
            for other in {*objects, *standing} - {geom}:
                gap = np.linalg.norm((data.geom_xpos[geom] - data.geom_xpos[other])[:2])
                radius = np.hypot(*model.geom_aabb[geom, 3:5])
                assert gap > radius + CLEARANCE, (seed, model.geom(geom).name, model.geom(other).name)


@pytest.mark.parametrize(
    ("look", "option"),
    [("distractors", {"count": 99}), ("moved-camera", {"angle": 90.0}), ("plain", {"hue": 0.1})],
)
def test_impossible_options_are_refused(look, option):
    with pytest.raises(ValidationError):
        plugins().spec("look", look).config(**option)
