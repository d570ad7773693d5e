"""Every law of Section III, over every primitive, and again over thousands of seeds."""

from __future__ import annotations

import pytest
from laws import LAWS
from laws.marker import the_marker_lies_flat_on_the_floor_and_in_the_third_view
from laws.start import START
from motion_material import MOTIONS, PRIMITIVES, stage

EACH = [
    pytest.param(motion, law, id=f"{motion}-{law.__name__}") for motion in MOTIONS for law in LAWS[motion]
]
SIZES = [(96, 96), (128, 128), (480, 640)]


@pytest.mark.parametrize(("motion", "law"), EACH)
def test_it_holds(takes, motion, law):
    for take in takes(motion):
        law(take)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("motion", MOTIONS)
def test_the_first_frames_hold_what_they_must_at_every_size(takes, motion, size):
    for take in takes(motion, size=size):
        assert (take.scene.hand.view.height, take.scene.hand.view.width) == size
        for law in START:
            law(take)
        if take.trajectory.marker_points is not None:
            the_marker_lies_flat_on_the_floor_and_in_the_third_view(take)


def test_the_takes_hold_every_primitive_equally_often(takes):
    for motion in MOTIONS:
        names = [take.primitive.name for take in takes(motion)]
        assert {name: names.count(name) for name in PRIMITIVES} == dict.fromkeys(PRIMITIVES, 15)


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("motion", MOTIONS)
def test_it_holds_over_thousands_of_seeds(motion, size):
    for index in range(300 * len(PRIMITIVES)):
        take = stage(motion, index, size=size)
        for law in LAWS[motion]:
            law(take)


@pytest.mark.slow
@pytest.mark.parametrize("motion", MOTIONS)
def test_it_holds_at_the_papers_length(motion):
    for index in range(200):
        take = stage(motion, index, steps=300)
        assert len(take.trajectory.phases) == 300
        for law in LAWS[motion]:
            law(take)
