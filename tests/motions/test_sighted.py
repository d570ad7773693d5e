"""The packaged config `sighted`: its laws over many seeds, and what its data as a whole must be like."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from laws.sighted import SIGHTED

from geoprior.config import load_config
from geoprior.hooks.manager import plugins
from geoprior.synthesis.studio import Studio

SEED = 77
COUNT = 100
MOTIONS = tuple(SIGHTED)
EACH = [
    pytest.param(motion, law, id=f"{motion}-{law.__name__}") for motion in MOTIONS for law in SIGHTED[motion]
]


@cache
def config():
    return load_config("sighted", [], plugins())


@cache
def studio():
    return Studio(config().generate, config().cameras, SEED)


def stage(motion, index):
    choice = next(each for each in config().generate.motions if each.name == motion)
    return studio().stage(choice, index)


@cache
def takes(motion):
    return [stage(motion, index) for index in range(COUNT)]


@pytest.mark.parametrize(("motion", "law"), EACH)
def test_it_holds(motion, law):
    for take in takes(motion):
        law(take)


@pytest.mark.slow
@pytest.mark.parametrize("motion", MOTIONS)
def test_it_holds_over_thousands_of_seeds(motion):
    for index in range(COUNT, COUNT + 3000):
        take = stage(motion, index)
        for law in SIGHTED[motion]:
            law(take)


def explained(features, values):
    """R2 of values (E, K) from features (E, F) and a constant, by least squares: the highest of the K."""
    design = np.column_stack([np.ones(len(features)), features])
    rest = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    return float((1.0 - rest.var(axis=0) / values.var(axis=0)).max())


def start_and_object(take):
    """What the start pose tells, with the place on the floor that it points to; and where the object is."""
    pose, floor = take.trajectory.hand.transforms_hand_to_world[0], take.scene.floor.height
    position, forward = pose[:3, 3], pose[:3, 2]
    meets = position + (floor - position[2]) / forward[2] * forward
    return np.concatenate([pose[:3].ravel(), meets[:2]]), take.scene.object.centre[:2]


def test_the_start_says_little_of_where_the_object_lies():
    found = [start_and_object(take) for motion in MOTIONS for take in takes(motion)]
    features, centres = map(np.array, zip(*found, strict=True))
    assert centres.std(axis=0) == pytest.approx([0.0866, 0.0866], rel=0.1), "it lies anywhere"
    assert explained(features, centres) < 0.25


def test_the_papers_start_says_where_the_object_lies():
    """That the test above can fail."""
    paper = load_config("lite", [], plugins())
    made = Studio(paper.generate, paper.cameras, SEED)
    found = [start_and_object(made.stage(paper.generate.motions[0], index)) for index in range(COUNT)]
    features, centres = map(np.array, zip(*found, strict=True))
    assert explained(features, centres) > 0.8


def speeds(take, steps=None):
    """Millimetres from step to step."""
    way = take.trajectory.hand.transforms_hand_to_world[:steps, :3, 3]
    return 1e3 * np.linalg.norm(np.diff(way, axis=0), axis=1)


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_hand_moves_as_fast_as_in_demonstrations(motion):
    """Scripted ones have 8 to 10 mm a step of a tenth of a second, and 9 to 13 in their first 2.5 s."""
    assert 6.0 < np.mean([speeds(take).mean() for take in takes(motion)]) < 12.0
    assert 8.0 < np.mean([speeds(take, 26).mean() for take in takes(motion)]) < 13.0


@pytest.mark.parametrize(
    ("motion", "low", "high"), [("pick", 0.45, 0.57), ("place", 0.45, 0.65), ("push", 0.95, 1.0)]
)
def test_the_gripper_is_closed_as_long_as_in_demonstrations(motion, low, high):
    shares = [take.trajectory.hand.gripper.mean() for take in takes(motion)]
    assert low < np.mean(shares) < high


def test_episodes_last_as_long_as_the_range_says():
    low, high = config().generate.seconds
    steps = np.array([take.trajectory.steps for motion in MOTIONS for take in takes(motion)])
    assert steps.min() >= low * 10
    assert steps.max() <= high * 10
    assert steps.std() == pytest.approx(10 * (high - low) / np.sqrt(12.0), rel=0.15)


def test_the_share_of_starts_that_point_straight_down_is_as_stated():
    down = [
        take.trajectory.hand.transforms_hand_to_world[0, 2, 2] < -np.cos(np.radians(4.0))
        for motion in MOTIONS
        for take in takes(motion)
    ]
    assert 0.5 < np.mean(down) < 0.75
