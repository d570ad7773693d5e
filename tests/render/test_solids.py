"""The renderer of solids against rays cast one pixel at a time, and its laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from solids_material import differing, reference_frame

from geoprior.executors.local import LocalConfig, LocalExecutor, SerialExecutor
from geoprior.geometry.camera import CamerasConfig, pinhole_intrinsics
from geoprior.geometry.projection import View
from geoprior.geometry.se3 import invert, look_at, make_transform
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.render.appearance import AppearanceConfig, draw_appearance
from geoprior.render.clouds import Cloud, Shot
from geoprior.render.solids import SolidsConfig
from geoprior.scene.mesh import Mesh, box, convex_mesh, square
from geoprior.shards.reader import EpisodeStore
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.generate import generate
from geoprior.synthesis.studio import Studio, stage_episode

MOTIONS = ("pick", "place", "push")
PRIMITIVES = ("prism", "pyramid", "cylinder", "cone", "sphere", "truncated-pyramid", "truncated-cone")
SIZES = [(40, 52), (33, 48)]
ROUNDING = 1e-4
"""Pixels by which a ray may be moved to meet what was drawn."""


def renderer(**options):
    return plugins().build("renderer", Choice(name="solids", options=options))


def take(motion, index, size=(40, 52), primitive=None, steps=6, renderer="solids", **generate):
    primitives = [Choice(name=primitive)] if primitive else [Choice(name=name) for name in PRIMITIVES]
    config = GenerateConfig(fps=steps, seconds=1.0, primitives=primitives, renderer=renderer, **generate)
    return stage_episode(config, CamerasConfig(height=size[0], width=size[1]), 8, Choice(name=motion), index)


def assert_as_cast(shot, steps=None):
    """Every pixel is the reference's, or at an edge: the colour of a ray moved by less than rounding is."""
    appearance = draw_appearance(SolidsConfig(), shot.seed)
    frames = renderer().render(shot)
    drawn = 0
    for step in range(shot.steps) if steps is None else steps:
        reference = reference_frame(shot, appearance, step)
        off = differing(frames[step], reference)
        drawn += np.count_nonzero(differing(reference, 255.0 * appearance.background))
        if off.any():
            assert off.mean() < 0.005, f"step {step}: {np.count_nonzero(off)} pixels"
            for shift in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                moved = reference_frame(shot, appearance, step, ROUNDING * np.array(shift))
                off &= differing(frames[step], moved)
            assert not off.any(), f"step {step}: pixels {np.argwhere(off)[:5].tolist()}"
    return drawn


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("primitive", PRIMITIVES)
def test_every_pixel_is_what_its_ray_meets(motion, primitive):
    size = SIZES[PRIMITIVES.index(primitive) % 2]
    for shot in take(motion, 1, size, primitive).shots.values():
        assert assert_as_cast(shot) > 0.05 * shot.steps * size[0] * size[1], "the test must be able to fail"


@pytest.mark.slow
@pytest.mark.parametrize("motion", MOTIONS)
def test_every_pixel_over_many_episodes(motion):
    for index in range(60):
        for shot in take(motion, index, (64, 64)).shots.values():
            assert_as_cast(shot)


def ball(radius, count=40):
    rng = np.random.default_rng(3)
    points = rng.normal(size=(count, 3))
    return convex_mesh(radius * points / np.linalg.norm(points, axis=1, keepdims=True))


def close_view(rng, steps, away, size=(30, 41)):
    """A camera that moves at random near the origin, looking anywhere."""
    turned = Rotation.random(steps, random_state=int(rng.integers(1 << 30))).as_matrix()
    cameras = make_transform(turned, rng.normal(size=(steps, 3)) * away)
    return View(invert(cameras), pinhole_intrinsics(*size, 80.0), *size)


@pytest.mark.parametrize("away", [0.001, 0.02, 0.05, 0.15])
def test_cameras_within_bodies_and_beside_them_and_floors_behind_them(away):
    """What is nearer than 1 cm is cut off, what is seen from within is not drawn."""
    rng = np.random.default_rng(int(1e3 * away))
    clouds = (
        Cloud("floor", np.zeros((1, 3)), np.eye(4), square(0.8, -0.02)),
        Cloud("object", np.zeros((1, 3)), np.eye(4), ball(0.04)),
        Cloud("crate", np.zeros((1, 3)), np.eye(4), box(np.full(3, -0.03), np.array([0.05, 0.02, 0.09]))),
    )
    shot = Shot(close_view(rng, 40, away), clouds, 40, 9)
    assert assert_as_cast(shot) > 1000


def test_the_hand_camera_at_the_end_of_a_grasp():
    for index in range(8):
        shot = take("pick", index, steps=12).shots["hand"]
        assert_as_cast(shot, steps=range(8, 12))


def overhead(size=(64, 64), height=0.5):
    pose = look_at(np.array([0.0, 0.0, height]), np.zeros(3), np.array([1.0, 0.0, 0.0]))
    return View(invert(pose), pinhole_intrinsics(*size, 60.0), *size)


def test_a_body_hides_what_is_behind_it_in_any_order():
    low = Cloud("object", np.zeros((1, 3)), np.eye(4), box(np.full(3, -0.1), np.full(3, 0.0)))
    high = Cloud(
        "hand", np.zeros((1, 3)), np.eye(4), box(np.array([-0.05, -0.05, 0.1]), np.array([0.05, 0.05, 0.2]))
    )
    one = renderer().render(Shot(overhead(), (low, high), 1, 4))
    other = renderer().render(Shot(overhead(), (high, low), 1, 4))
    np.testing.assert_array_equal(one, other)
    alone = renderer().render(Shot(overhead(), (high,), 1, 4))
    seen = differing(alone, 255.0 * draw_appearance(SolidsConfig(), 4).background)
    assert 20 < np.count_nonzero(seen) < 2000
    np.testing.assert_array_equal(one[seen], alone[seen])
    assert (one[~seen] != alone[~seen]).any()


@pytest.mark.parametrize("motion", ["place", "push"])
def test_the_marker_lies_over_the_floor_wherever_it_is_seen(motion):
    """Drawn alone, floor and marker: every pixel of the marker's shape has its colour, none flickers."""
    for index in range(12):
        for shot in take(motion, index).shots.values():
            both = tuple(cloud for cloud in shot.clouds if cloud.body in {"floor", "marker"})
            marker = tuple(cloud for cloud in both if cloud.body == "marker")
            assert [cloud.body for cloud in both] == ["floor", "marker"]
            appearance = draw_appearance(SolidsConfig(), shot.seed)
            shade = 255.0 * (appearance.ambient + appearance.light[2]) * appearance.colour("marker")
            seen = ~differing(renderer().render(replace(shot, clouds=marker)), 255.0 * appearance.background)
            over = renderer().render(replace(shot, clouds=both))
            assert not differing(over, shade)[~seen].any()


def test_colours_and_light_are_the_same_for_every_camera_and_step_alone_or_in_parts():
    made = renderer()
    for motion in MOTIONS:
        staged = take(motion, 3)
        assert len({shot.seed for shot in staged.shots.values()}) == 1
        for shot in staged.shots.values():
            whole = made.render(shot)
            parts = [renderer().render(shot.at(slice(first, first + 2))) for first in range(0, 6, 2)]
            np.testing.assert_array_equal(np.concatenate(parts), whole)
            backwards = renderer().render(shot.at(np.arange(6)[::-1]))
            np.testing.assert_array_equal(backwards[::-1], whole)


def test_bodies_differ_from_the_floor_and_episodes_from_each_other():
    config, seen = SolidsConfig(), set()
    for seed in range(400):
        made = draw_appearance(config, seed)
        assert np.isclose(made.ambient + np.linalg.norm(made.light), 1.0)
        assert made.light[2] > 0.0
        for ground in (made.floor, made.background):
            assert 0.15 - 1e-9 <= ground.max() <= 0.95
            assert 1.0 - ground.min() / ground.max() <= 0.2 + 1e-9
        for body in ("object", "marker", "hand", "finger-of-a-plug-in"):
            colour = made.colour(body)
            assert np.abs(colour - made.floor).max() >= 0.25
            assert ((colour >= 0.0) & (colour <= 1.0)).all()
            seen.add(tuple(colour))
    assert len(seen) == 4 * 400


@pytest.mark.parametrize("gray", [0.15, 0.525, 0.95])
def test_the_largest_contrast_can_be_kept_with_every_floor(gray):
    config = AppearanceConfig(contrast=0.4, saturation=0.0, ground=(gray, gray))
    for seed in range(50):
        assert np.abs(draw_appearance(config, seed).colour("object") - gray).max() >= 0.4


def test_options_change_what_they_say():
    shot = take("place", 2).shots["third"]
    bright = renderer(ambient=[0.99, 0.99]).render(shot)
    colours = {tuple(colour) for colour in bright[0].reshape(-1, 3).tolist()}
    assert len({tuple(np.round(np.array(colour) / 8)) for colour in colours}) <= 8, (
        "without shade all is flat"
    )
    gray = renderer(saturation=0.0, ground=[0.5, 0.5]).render(replace(shot, clouds=shot.clouds[:1]))
    assert (gray[..., 0] == gray[..., 1]).all()


def test_black_images_are_black_and_bodies_of_points_alone_are_not_drawn():
    shot = take("place", 2).shots["third"]
    for black in take("place", 2, variants=["black-images"]).shots.values():
        assert not renderer().render(black).any()
    bare = tuple(replace(cloud, surface=None) for cloud in shot.clouds)
    empty = renderer().render(replace(shot, clouds=bare))
    assert len(np.unique(empty.reshape(-1, 3), axis=0)) == 1
    half = (*shot.clouds[:1], *bare[1:])
    np.testing.assert_array_equal(
        renderer().render(replace(shot, clouds=half)),
        renderer().render(replace(shot, clouds=shot.clouds[:1])),
    )


@pytest.mark.parametrize("motion", MOTIONS)
def test_without_the_hand_cube_what_was_behind_it_is_seen_and_nothing_else_changes(motion):
    original, changed = take(motion, 2), take(motion, 2, variants=["no-hand-cube"])
    made = renderer()
    np.testing.assert_array_equal(made.render(original.shots["hand"]), made.render(changed.shots["hand"]))
    with_hand, without = made.render(original.shots["third"]), made.render(changed.shots["third"])
    cube = tuple(cloud for cloud in original.shots["third"].clouds if cloud.body == "hand")
    alone = made.render(replace(original.shots["third"], clouds=cube))
    covered = differing(
        alone, 255.0 * draw_appearance(SolidsConfig(), original.shots["third"].seed).background
    )
    assert (with_hand != without).any(axis=(1, 2, 3)).all()
    np.testing.assert_array_equal(with_hand[~covered], without[~covered])


def test_a_face_without_area_is_not_drawn_and_harms_nothing():
    clean = box(np.full(3, -0.05), np.full(3, 0.05))
    dirty = Mesh(clean.vertices, np.vstack([[[0, 0, 1], [3, 3, 3]], clean.faces]))
    one, other = (
        renderer().render(Shot(overhead(), (Cloud("object", np.zeros((1, 3)), np.eye(4), mesh),), 1, 5))
        for mesh in (clean, dirty)
    )
    np.testing.assert_array_equal(one, other)


def test_episodes_in_memory_and_in_shards_are_the_same():
    made = Studio(
        GenerateConfig(fps=60, seconds=1.0, renderer="solids"), CamerasConfig(height=128, width=128), 3
    )
    episode, sample = made.episode(Choice(name="push"), 0), made.sample(Choice(name="push"), 0)
    for camera, blocks in sample.frames.items():
        cut = list(blocks)
        assert len(cut) > 1, "the test must be able to fail"
        np.testing.assert_array_equal(np.concatenate(cut), episode.images[camera])
    assert [camera.frame_format.kind for camera in episode.header.cameras] == ["rgb", "rgb"]


def test_shards_are_the_same_bytes_with_any_number_of_workers_and_cut_in_any_way(tmp_path):
    config = GenerateConfig(
        fps=10, seconds=1.0, episodes=2, motions=["pick", "push"], episodes_per_shard=2, renderer="solids"
    )
    cameras = CamerasConfig(height=32, width=36)
    digests = [
        generate(config, cameras, seed=3, executor=executor, out=tmp_path / str(number)).digest
        for number, executor in enumerate((SerialExecutor(), LocalExecutor(LocalConfig(workers=2))))
    ]
    assert digests[0] == digests[1]
    alone = Studio(config, cameras, 3).episode(Choice(name="push"), 1)
    store = EpisodeStore(tmp_path / "0")
    np.testing.assert_array_equal(
        store.frames(store.position("push-000001"), "third", range(10)), alone.images["third"]
    )
