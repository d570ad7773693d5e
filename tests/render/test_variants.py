"""What the variants take from the cameras, and that they take nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoprior import VariantSpec, hookimpl
from geoprior.config import load_config
from geoprior.errors import ConfigError, PluginError
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice, Options
from geoprior.render import rig
from geoprior.render.variation import vary
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import recipe, stage_episode, synthesise

CAMERAS = CamerasConfig(height=64, width=64)
MOTIONS = ("pick", "place", "push", "random-walk")
VARIANTS = ("black-images", "no-hand-cube")


def config(*variants):
    return GenerateConfig(fps=12, seconds=1.0, variants=[Choice(name=name) for name in variants])


def episode(motion, *variants, index=0):
    return synthesise(config(*variants), CAMERAS, 4, Choice(name=motion), index)


def staged(motion, *variants):
    return stage_episode(config(*variants), CAMERAS, 4, Choice(name=motion), 0)


def render(shot):
    return rig.render(plugins().build("renderer", Choice(name="points")), shot)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("motion", MOTIONS)
def test_the_motion_and_the_scene_stay_as_they_were(motion, variant):
    for index in range(5):
        original, changed = episode(motion, index=index), episode(motion, variant, index=index)
        np.testing.assert_array_equal(changed.pose, original.pose)
        np.testing.assert_array_equal(changed.action, original.action)
        changed.validate()
        details, before = changed.header.details, original.header.details
        assert details.pop("variants") == [variant]
        assert details.pop("recipe") != before.pop("recipe")
        assert changed.header == original.header


@pytest.mark.parametrize("motion", MOTIONS)
def test_black_images_are_black(motion):
    assert all(images.any() for images in episode(motion).images.values())
    black = episode(motion, "black-images").images
    assert set(black) == {"hand", "third"}
    for images in black.values():
        assert images.shape == (12, 64, 64)
        assert not images.any()


@pytest.mark.parametrize("motion", MOTIONS)
def test_without_the_cube_the_hands_view_is_the_same_and_the_third_lacks_the_cube_only(motion):
    original, changed = episode(motion).images, episode(motion, "no-hand-cube").images
    np.testing.assert_array_equal(changed["hand"], original["hand"])
    shot = staged(motion).shots["third"]
    parts = {
        kept: replace(shot, clouds=tuple(cloud for cloud in shot.clouds if (cloud.body == "hand") is kept))
        for kept in (True, False)
    }
    cube, rest = render(parts[True]), render(parts[False])
    np.testing.assert_array_equal(changed["third"], rest)
    np.testing.assert_array_equal(original["third"], np.maximum(cube, rest))
    assert (changed["third"] != original["third"]).any(axis=(1, 2)).all(), "every frame showed the cube"


def test_without_variants_nothing_is_said_and_nothing_is_changed():
    assert "variants" not in episode("place").header.details
    shots = rig.shots(staged("place").scene, staged("place").trajectory)
    assert vary(shots, []) is shots


def test_variants_apply_in_order_and_the_header_tells_the_order():
    both = episode("push", "no-hand-cube", "black-images")
    assert both.header.details["variants"] == ["no-hand-cube", "black-images"]
    assert not any(images.any() for images in both.images.values())


class Renamed:
    def __init__(self, name):
        self.name = name

    def change(self, shots):
        def marked(shot):
            return replace(shot, clouds=tuple(replace(cloud, body=self.name) for cloud in shot.clouds))

        return {camera: marked(shot) for camera, shot in shots.items()}


def test_the_next_variant_sees_what_the_last_one_left():
    shots = vary(staged("pick").shots, [Renamed("first"), Renamed("second")])
    assert {cloud.body for shot in shots.values() for cloud in shot.clouds} == {"second"}


def test_variants_and_their_order_are_part_of_the_recipe():
    recipes = {
        recipe(config(*variants), CAMERAS, 4, Choice(name="pick"))
        for variants in ((), VARIANTS[:1], VARIANTS[1:], VARIANTS, VARIANTS[::-1])
    }
    assert len(recipes) == 5


class Faulty:
    def __init__(self, fault):
        self.fault = fault

    def change(self, shots):
        return self.fault(shots)


@pytest.mark.parametrize(
    ("fault", "complaint"),
    [
        (lambda shots: {"hand": shots["hand"]}, r"gave \['hand'\]"),
        (lambda shots: {**shots, "top": shots["third"]}, "'top'"),
        (lambda shots: {**shots, "hand": shots["third"]}, "the view of camera 'hand'"),
        (lambda shots: {**shots, "third": shots["third"].at(slice(0, 3))}, "steps of camera 'third'"),
        (lambda shots: {**shots, "third": replace(shots["third"], steps=3)}, "the steps of camera 'third'"),
        (lambda shots: {**shots, "third": replace(shots["third"], seed=3)}, "the seed of camera 'third'"),
    ],
)
def test_a_variant_that_changes_more_than_clouds_is_refused_by_name(fault, complaint):
    with pytest.raises(PluginError, match=f"variant Faulty.*{complaint}"):
        vary(staged("pick").shots, [Faulty(fault)])


class FogConfig(Options):
    body: str = "floor"


class FogPlugin:
    @hookimpl
    def geoprior_variants(self):
        yield VariantSpec("fog", "for a test", FogConfig, lambda options: Renamed(options.body))


def test_somebody_elses_variant_is_found_by_name_and_its_options_are_written_out(fresh_plugins):
    fresh_plugins.register(FogPlugin(), name="fog", package="weather", version="1")
    resolved = load_config("lite", ["generate.variants=[fog]"], fresh_plugins)
    assert resolved.generate.variants == [Choice(name="fog", options={"body": "floor"})]
    variant = fresh_plugins.build("variant", Choice(name="fog", options={"body": "hidden"}))
    assert {cloud.body for cloud in vary(staged("pick").shots, [variant])["hand"].clouds} == {"hidden"}


@pytest.mark.parametrize(
    ("override", "message", "hint"),
    [
        ("generate.variants=[black-image]", "unknown variant 'black-image'", "did you mean 'black-images'"),
        ("generate.variants=[{name: no-hand-cube, sides: 3}]", "option 'sides'", "its options: none"),
        ("generate.variants=black-images", "key 'generate.variants'", "found"),
    ],
)
def test_a_wrong_name_or_option_is_told_before_anything_runs(override, message, hint):
    with pytest.raises(ConfigError) as caught:
        load_config("lite", [override], plugins())
    assert message in caught.value.message
    assert hint in caught.value.hint
