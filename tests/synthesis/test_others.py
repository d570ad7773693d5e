"""Scenes of any number of objects: a motion's spec names them, a trajectory moves any of them."""

from __future__ import annotations

import numpy as np
import pytest

from geoprior import MotionSpec, hookimpl
from geoprior.errors import PluginError
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import Plugins
from geoprior.motions.trajectory import Trajectory, way_of_hand
from geoprior.options import Choice, Options
from geoprior.render import rig
from geoprior.scene.config import OtherConfig
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.writer import write_samples
from geoprior.synthesis import studio as synthesis
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import Studio
from geoprior.view.scenery import marks_of
from geoprior.view.world import bodies_of, world_of

CAMERAS = CamerasConfig(height=48, width=64)


class TrainOptions(Options):
    wagons: int = 2
    runaway: bool = False


class Train:
    """The first wagon slides away at a centimetre a step; the others, and the object, stay."""

    def __init__(self, config):
        self.config = config

    def plan(self, scene, steps, rng):
        slid = np.repeat(scene.others["wagon-1"].transform_object_to_world[None], steps, axis=0)
        slid[:, 0, 3] += 0.01 * np.arange(steps)
        return Trajectory(
            hands=way_of_hand(
                np.repeat(scene.hand.transform_hand_to_world[None], steps, axis=0), np.zeros(steps)
            ),
            transforms_object_to_world=np.repeat(scene.object.transform_object_to_world[None], steps, axis=0),
            marker_points=None,
            phases=("slide",) * steps,
            others={"runaway" if self.config.runaway else "wagon-1": slid},
        )


def wagons(config):
    small = OtherConfig(primitives=[Choice(name="sphere", options={"diameter": [0.03, 0.04]})])
    return {f"wagon-{number + 1}": small for number in range(config.wagons)}


class Module:
    @hookimpl
    def geoprior_motions(self):
        yield MotionSpec("train", "wagons behind the object", TrainOptions, Train, others=wagons)
        for name in ("object", "floor", "marker", "hand"):
            yield MotionSpec(
                f"a-{name}", "no", Options, Train, others=lambda _, name=name: {name: OtherConfig()}
            )


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    found = Plugins()
    found.load_builtins()
    found.register(Module(), name="train", package="tests", version="1")
    monkeypatch.setattr(synthesis, "plugins", lambda: found)


def studio(*motions, **options):
    return Studio(GenerateConfig(fps=6, seconds=1.0, motions=list(motions), **options), CAMERAS, 4)


TRAIN = Choice(name="train")


def test_the_options_say_which_objects_there_are():
    three = Choice(name="train", options={"wagons": 3})
    take = studio(three).stage(three, 0)
    assert list(take.scene.objects) == ["object", "wagon-1", "wagon-2", "wagon-3"]
    assert {choice.name for choice in take.others.values()} == {"sphere"}
    centres = [each.centre[:2] for each in take.scene.objects.values()]
    for number, one in enumerate(centres):
        assert all(np.linalg.norm(one - other) > 0.03 for other in centres[:number])


def test_the_header_tells_each_object_and_comes_back_from_a_shard(tmp_path):
    made = studio(TRAIN)
    take, episode = made.stage(TRAIN, 1), made.episode(TRAIN, 1)
    write_samples(tmp_path / "a.tar", [made.sample(TRAIN, 1)])
    told = EpisodeStore(tmp_path / "a.tar").header(0).details["others"]
    assert told == episode.header.details["others"]
    assert list(told) == ["wagon-1", "wagon-2"]
    for name, other in take.scene.others.items():
        assert told[name]["primitive"] == {"name": "sphere", **other.mesh.parameters}
        np.testing.assert_allclose(told[name]["extents"], np.ptp(other.mesh.vertices, axis=0))
        np.testing.assert_allclose(told[name]["position"], other.centre)
    moved = np.subtract(told["wagon-1"]["final_position"], told["wagon-1"]["position"])
    np.testing.assert_allclose(moved, [0.05, 0.0, 0.0], atol=1e-12)
    assert told["wagon-2"]["final_position"] == told["wagon-2"]["position"]


def test_what_moves_is_seen_to_move_and_what_rests_to_rest():
    take = studio(TRAIN).stage(TRAIN, 0)
    clouds = {cloud.body: cloud for cloud in take.shots[rig.THIRD].clouds}
    assert list(clouds) == ["floor", "object", "wagon-1", "wagon-2", "hand"]
    assert clouds["wagon-1"].transforms_cloud_to_world.shape == (6, 4, 4)
    resting = take.scene.others["wagon-2"].transform_object_to_world
    np.testing.assert_array_equal(clouds["wagon-2"].transforms_cloud_to_world, resting)


def test_the_view_in_space_draws_every_object_and_without_points_every_box():
    made = studio(TRAIN)
    take, episode = made.stage(TRAIN, 0), made.episode(TRAIN, 0)
    bodies = bodies_of(take)
    assert [solid.body for solid in bodies.solids] == ["object", "wagon-1", "wagon-2"]
    known = world_of(episode.header, episode.pose, bodies)
    alone = world_of(episode.header, episode.pose)
    assert (len(known.objects), len(alone.objects)) == (0, 3)
    header = episode.header.model_copy(update={"details": {**episode.header.details, "others": {}}})
    fewer = world_of(header, episode.pose)
    # a resting object has one box, and the one that slides a box at either end
    assert len(list(marks_of(alone, 0))) - len(list(marks_of(fewer, 0))) == 3


def test_built_in_motions_beside_it_make_what_they_make_without_it():
    push = Choice(name="push")
    alone, beside = studio(push).episode(push, 2), studio(TRAIN, push).episode(push, 2)
    assert alone.header == beside.header
    assert "others" not in alone.header.details
    for name, frames in alone.images.items():
        np.testing.assert_array_equal(frames, beside.images[name])


@pytest.mark.parametrize("name", ["object", "floor", "marker", "hand"])
def test_a_further_object_named_like_a_body_of_every_scene_is_refused(name):
    motion = Choice(name=f"a-{name}")
    with pytest.raises(PluginError, match=f"motion 'a-{name}': its spec names a further object '{name}'"):
        studio(motion).stage(motion, 0)


def test_a_trajectory_that_moves_what_is_not_there_is_refused():
    motion = Choice(name="train", options={"runaway": True})
    with pytest.raises(PluginError, match="motion 'train': moves 'runaway', which its scene does not have"):
        studio(motion).stage(motion, 0)
