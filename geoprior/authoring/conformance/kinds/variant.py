"""A variant: the same cameras with other clouds, and nothing else changed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoprior.authoring.conformance.check import Check, digest, require, require_array
from geoprior.authoring.conformance.material import builtins, scene
from geoprior.geometry.seeding import generator
from geoprior.hooks.types import Motion, VariantSpec
from geoprior.options import Choice
from geoprior.render import rig
from geoprior.render.clouds import Shot
from geoprior.render.variation import vary

STEPS = 12


def _shots(number: int) -> Mapping[str, Shot]:
    motions = ("pick", "place", "push")
    motion: Motion = builtins().build("motion", Choice(name=motions[number % len(motions)]))
    before = scene(number)
    return rig.shots(before, motion.plan(before, STEPS, generator(number, "conformance")))


def cameras_stay(spec: VariantSpec) -> None:
    """`geoprior.render.variation.vary` accepts what it gives, and refuses cameras that have changed."""
    for number in range(6):
        vary(_shots(number), [spec.factory(spec.config())])


def clouds_can_be_drawn(spec: VariantSpec) -> None:
    """Clouds hold points in metres, at rest or with a transform for each step."""
    for number in range(6):
        for camera, shot in vary(_shots(number), [spec.factory(spec.config())]).items():
            for cloud in shot.clouds:
                where = f"variant {spec.name!r}, scene {number}, camera {camera!r}, {cloud.body}"
                require_array(cloud.points, f"{where}: points", (None, 3), np.float64)
                moves = np.ndim(cloud.transforms_cloud_to_world) == 3
                shape = (STEPS, 4, 4) if moves else (4, 4)
                require_array(cloud.transforms_cloud_to_world, f"{where}: transforms", shape, np.float64)


def what_it_was_given_stays(spec: VariantSpec) -> None:
    """The shots that go in are not written to."""
    variant = spec.factory(spec.config())
    for number in range(6):
        shots = _shots(number)
        before = digest(shots)
        variant.change(shots)
        require(
            digest(shots) == before,
            f"variant {spec.name!r}, scene {number}: wrote to the shots that it was given",
            "give others back: dataclasses.replace(shot, clouds=...)",
        )


def it_repeats_itself(spec: VariantSpec) -> None:
    """The same shots give the same shots: there is no generator to draw from."""
    for number in range(6):
        first, again = (digest(spec.factory(spec.config()).change(_shots(number))) for _ in range(2))
        require(
            first == again,
            f"variant {spec.name!r}, scene {number}: the second time gives other clouds",
            "what is drawn at random must follow from an option and from the shots alone",
        )


CHECKS = (
    Check("it leaves cameras and steps alone", cameras_stay),
    Check("its clouds can be drawn", clouds_can_be_drawn),
    Check("it writes to nothing that it was given", what_it_was_given_stays),
    Check("it gives the same clouds each time", it_repeats_itself),
)
