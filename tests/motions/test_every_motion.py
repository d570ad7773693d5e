"""Steps and phases, and scenes that are left as they were."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_material import MOTIONS, stage

from geoprior.errors import ConfigError
from geoprior.hooks.manager import plugins
from geoprior.options import Choice

FEWEST = {"pick": 2, "place": 3, "push": 3}


@cache
def scene_of(motion):
    return stage(motion, 0).scene


def planned(motion, steps, **options):
    planner = plugins().build("motion", Choice(name=motion, options=options))
    return planner.plan(scene_of(motion), steps, np.random.default_rng(0))


def assert_refused(motion, steps, fewest, **options):
    with pytest.raises(ConfigError) as fault:
        planned(motion, steps, **options)
    assert fault.value.message == f"motion {motion!r}: {steps} steps are too few, it needs {fewest}"
    assert "generate.fps" in fault.value.hint


def counts(trajectory):
    phases = trajectory.phases
    runs = [name for i, name in enumerate(phases) if i == 0 or phases[i - 1] != name]
    assert len(runs) == len(set(runs)), "a phase comes once"
    return {name: phases.count(name) for name in runs}


def assert_moves_on(trajectory, phases):
    """The hand moves at every step but those that hold still after the first of a phase in ``phases``."""
    frames, names = trajectory.hand.transforms_hand_to_world, trajectory.phases
    for step in range(1, len(names)):
        still = names[step] in phases and names[step - 1] == names[step]
        assert np.array_equal(frames[step], frames[step - 1]) == still


@pytest.mark.parametrize(
    ("motion", "expected"),
    [
        ("pick", {"approach": 299, "grasp": 1}),
        ("place", {"approach": 149, "grasp": 1, "transport": 149, "release": 1}),
        ("push", {"approach": 150, "push": 150}),
    ],
)
def test_ten_seconds_at_thirty_frames_a_second(motion, expected):
    trajectory = planned(motion, 300)
    assert counts(trajectory) == expected
    assert len(trajectory.hand.gripper) == 300


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 400), st.integers(1, 5))
def test_pick_holds_at_the_end_and_approaches_before(steps, closed):
    if steps < closed + 1:
        assert_refused("pick", steps, closed + 1, closed=closed)
        return
    trajectory = planned("pick", steps, closed=closed)
    assert counts(trajectory) == {"approach": steps - closed, "grasp": closed}
    np.testing.assert_array_equal(trajectory.hand.gripper, [0.0] * (steps - closed) + [1.0] * closed)
    assert_moves_on(trajectory, {"grasp"})


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 400), st.floats(0.01, 0.99), st.integers(1, 5), st.integers(1, 5))
def test_place_shares_its_steps_as_the_options_say(steps, approach, closed, opened):
    options = {"approach": approach, "closed": closed, "opened": opened}
    if steps < closed + opened + 1:
        assert_refused("place", steps, closed + opened + 1, **options)
        return
    trajectory = planned("place", steps, **options)
    reached = min(max(2, round(approach * steps)), steps - closed - opened + 1)
    moving = steps - (reached - 1) - closed - opened
    expected = {"approach": reached - 1, "grasp": closed, "transport": moving, "release": opened}
    assert counts(trajectory) == {name: count for name, count in expected.items() if count}
    open_before, open_after = [0.0] * (reached - 1), [0.0] * opened
    np.testing.assert_array_equal(
        trajectory.hand.gripper, open_before + [1.0] * (closed + moving) + open_after
    )
    assert_moves_on(trajectory, {"grasp", "release"})


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 400), st.floats(0.01, 0.99))
def test_push_shares_its_steps_as_the_options_say(steps, approach):
    if steps < 3:
        assert_refused("push", steps, 3, approach=approach)
        return
    trajectory = planned("push", steps, approach=approach)
    reached = min(max(2, round(approach * steps)), steps - 1)
    assert counts(trajectory) == {"approach": reached, "push": steps - reached}
    assert_moves_on(trajectory, set())


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_fewest_steps_do_and_fewer_are_refused_with_a_remedy(motion):
    fewest = FEWEST[motion]
    assert len(planned(motion, fewest).hand.gripper) == fewest
    for steps in range(1, fewest):
        assert_refused(motion, steps, fewest)


@pytest.mark.parametrize("motion", MOTIONS)
def test_planning_does_not_change_the_scene(motion):
    scene = scene_of(motion)
    before = scene.object.transform_object_to_world.copy(), scene.hand.transform_hand_to_world.copy()
    planner = plugins().build("motion", Choice(name=motion))
    planner.plan(scene, 20, np.random.default_rng(0))
    np.testing.assert_array_equal(scene.object.transform_object_to_world, before[0])
    np.testing.assert_array_equal(scene.hand.transform_hand_to_world, before[1])
