"""Options of the motions beyond the paper's: grasps and pushes from above, and eased phases."""

from __future__ import annotations

import numpy as np
import pytest
from motion_material import MOTIONS, stage

from geoprior.config import load_config
from geoprior.errors import ConfigError
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.motions.timing import eased, ramp
from geoprior.options import Choice
from geoprior.scene.config import FingersConfig, HandConfig, SceneConfig
from geoprior.synthesis.config import GenerateConfig
from geoprior.synthesis.studio import Studio

SCENE = SceneConfig(hand=HandConfig(setback=(0.09, 0.09), clearance=0.1, fingers=FingersConfig()))
SOLIDS = [Choice(name="prism", options={"width": (0.03, 0.05), "height": (0.03, 0.05)})]
COUNT = 30


def takes(motion, count=COUNT, steps=60, scene=SCENE, ease=(0.0, 0.0), primitives=SOLIDS, **options):
    config = GenerateConfig(fps=steps, seconds=1, scene=scene, primitives=primitives)
    studio = Studio(config, CamerasConfig(height=64, width=64), 9)
    choice = Choice(name=motion, options={"ease": ease, "from_above": options})
    return [studio.stage(choice, index) for index in range(count)]


def hands(take):
    return take.trajectory.hand.transforms_hand_to_world


def at_grasp(take):
    return hands(take)[take.trajectory.phases.index("grasp")]


@pytest.mark.parametrize("motion", MOTIONS)
def test_share_is_that_of_episodes_planned_from_above_and_the_others_are_the_papers(motion):
    mixed = takes(motion, share=0.5)
    plain = takes(motion, share=0.0)
    paper = [stage(motion, index).trajectory.phases for index in range(2)]
    changed = [not np.array_equal(hands(one), hands(other)) for one, other in zip(mixed, plain, strict=True)]
    assert 0.2 < np.mean(changed) < 0.8
    assert set(plain[0].trajectory.phases) == set(paper[0])


def test_the_hand_points_down_and_leans_by_up_to_tilt():
    for tilt in (0.0, 8.0):
        tilts = [
            np.degrees(np.arccos(np.clip(-at_grasp(take)[2, 2], -1, 1))) for take in takes("pick", tilt=tilt)
        ]
        assert max(tilts) <= tilt + 1e-6
        assert max(tilts) >= 0.7 * tilt


@pytest.mark.parametrize("motion", ["pick", "place"])
def test_the_origin_ends_as_deep_in_the_object_as_said(motion):
    for take in takes(motion, depth=(0.01, 0.02)):
        depth = take.scene.object.vertices[:, 2].max() - at_grasp(take)[2, 3]
        assert depth <= 0.02
        assert depth >= 0.01 - 1e-9 or at_grasp(take)[2, 3] < take.scene.floor.height + 0.03, (
            "or the floor is near"
        )


def test_it_goes_over_the_object_first_and_straight_down():
    for take in takes("pick", steps=400, above=(0.1, 0.1)):
        grasp = take.trajectory.phases.index("grasp")
        way = hands(take)[:grasp, :3, 3] - at_grasp(take)[:3, 3]
        straight = np.linalg.norm(way[:, :2], axis=1) < 1e-9
        assert way[straight, 2].max() == pytest.approx(0.1, abs=0.003)


def test_the_fingers_close_along_the_slender_side_at_the_nearest_of_the_like_yaws():
    bars = [Choice(name="prism", options={"sides": (4, 4), "distortion": 0.0, "stretched": 0.0})]
    for take in takes("pick", primitives=bars):
        turn = np.linalg.inv(hands(take)[0][:3, :3]) @ at_grasp(take)[:3, :3]
        right = at_grasp(take)[:2, 0]
        axes = take.scene.object.transform_object_to_world[:2, :2]
        assert np.abs(right @ axes).max() == pytest.approx(1.0), "along one of the sides"
        assert np.degrees(np.arccos((np.trace(turn) - 1.0) / 2.0)) < 110.0


def test_an_object_that_is_wider_than_the_fingers_open_is_touched_at_its_top():
    wide = [Choice(name="cylinder", options={"width": (0.118, 0.12), "stretched": 0.0})]
    for take in takes("pick", primitives=wide):
        tip = at_grasp(take)[2, 3] - take.scene.hand.fingers.past
        assert 0.0 < tip - take.scene.object.vertices[:, 2].max() < 0.01
        assert take.trajectory.hand.grip == 0.0


def test_the_object_is_lifted_or_stays():
    for take in takes("pick", lift=(0.1, 0.12)):
        way = take.trajectory.transforms_object_to_world[:, 2, 3]
        assert 0.1 - 1e-9 <= way[-1] - way[0] <= 0.12 + 1e-9
        assert take.trajectory.phases[-1] == "lift"
    for take in takes("pick"):
        assert np.ptp(take.trajectory.transforms_object_to_world, axis=0).max() == 0.0
        assert take.trajectory.phases[-1] == "grasp"


def test_longer_closing_closes_for_a_longer_share_of_the_steps():
    share = {
        seconds: np.mean(
            [take.trajectory.hand.gripper.mean() for take in takes("pick", closing=(seconds, seconds))]
        )
        for seconds in (0.5, 2.0)
    }
    assert 0.05 < share[0.5] < 0.3 < share[2.0] < 0.6


def test_pace_makes_legs_faster_or_slower():
    alike, unlike = (
        [take.trajectory.phases.index("grasp") for take in takes("pick", pace=pace)] for pace in (0.0, 0.8)
    )
    assert np.std(unlike) > np.std(alike)


def test_a_push_with_an_open_gripper_keeps_it_open():
    for closed, state in ((True, 1.0), (False, 0.0)):
        for take in takes("push", 5, closed=closed):
            assert set(take.trajectory.hand.gripper[1:]) == {state}
            assert take.trajectory.hand.gripper[0] == 0.0


@pytest.mark.parametrize("across", [0.0, 1.0])
def test_up_points_ahead_or_across_while_it_pushes(across):
    for take in takes("push", across=across):
        way = np.diff(take.trajectory.transforms_object_to_world[[0, -1], :2, 3], axis=0)[0]
        along = hands(take)[-1, :2, 1] @ way / np.linalg.norm(way)
        assert along == pytest.approx(0.0 if across else 1.0, abs=1e-9)


def test_the_hand_is_as_high_as_said_while_it_pushes_and_comes_down_behind():
    for take in takes("push", height=(0.01, 0.012), behind=(0.02, 0.03)):
        first = take.trajectory.phases.index("push")
        lowest = hands(take)[first:, 2, 3] - take.scene.hand.fingers.past - take.scene.floor.height
        assert np.all((lowest > 0.01 - 1e-9) & (lowest < 0.012 + 1e-9))
        moved = take.trajectory.transforms_object_to_world[:, :3, 3]
        begun = np.argmax(np.linalg.norm(moved - moved[0], axis=1) > 0.0)
        assert begun > first, "the hand moves before the object does"
        assert (
            0.02 - 1e-9
            <= (
                np.linalg.norm(hands(take)[-1, :3, 3] - hands(take)[first - 1, :3, 3])
                - np.linalg.norm(moved[-1] - moved[0])
            )
            <= 0.03 + 1e-9
        )


def test_a_push_without_fingers_pushes_with_the_cube():
    for take in takes("push", scene=SceneConfig(hand=HandConfig(clearance=0.1))):
        way = np.diff(take.trajectory.transforms_object_to_world[[0, -1], :3, 3], axis=0)[0]
        v_push, last = way / np.linalg.norm(way), take.trajectory.transforms_object_to_world[-1]
        cube = (take.scene.hand.points @ hands(take)[-1, :3, :3].T + hands(take)[-1, :3, 3]) @ v_push
        solid = (take.scene.object.mesh.vertices @ last[:3, :3].T + last[:3, 3]) @ v_push
        assert 0.0 < solid.min() - cube.max() < 0.011


def test_the_placed_object_stays_when_the_hand_rises():
    for take in takes("place", retreat=(0.07, 0.08)):
        moved = take.trajectory.transforms_object_to_world
        released = take.trajectory.phases.index("release")
        np.testing.assert_array_equal(moved[released:], np.broadcast_to(moved[-1], moved[released:].shape))
        assert 0.07 - 1e-9 <= hands(take)[-1, 2, 3] - hands(take)[released, 2, 3] <= 0.08 + 1e-9


def test_eased_times_run_from_0_to_1_and_are_smooth_at_the_ends():
    times = ramp(101)
    assert eased(times, 0.0) is times
    for ease in (0.3, 1.0):
        found = eased(times, ease)
        assert found[0] == 0.0
        assert found[-1] == 1.0
        assert np.all(np.diff(found) > 0.0)
        assert found[50] == pytest.approx(0.5)
    speed = np.diff(eased(times, 1.0))
    assert max(speed[0], speed[-1]) < 0.01 * speed.max()
    assert speed.max() == pytest.approx(0.01 * 15.0 / 8.0, rel=1e-3), "minimum jerk's peak"


@pytest.mark.parametrize("motion", MOTIONS)
def test_ease_changes_the_times_of_the_papers_way_and_nothing_else(motion):
    even, smooth = stage(motion, 3), stage(motion, 3, ease=(1.0, 1.0))
    np.testing.assert_allclose(hands(even)[-1], hands(smooth)[-1], atol=1e-12)
    np.testing.assert_allclose(hands(even)[0], hands(smooth)[0], atol=1e-12)
    first = np.linalg.norm(np.diff(hands(smooth)[:, :3, 3], axis=0), axis=1)
    assert first[0] < 0.1 * first.max()
    assert even.trajectory.phases == smooth.trajectory.phases


@pytest.mark.parametrize("motion", MOTIONS)
def test_too_few_steps_are_refused_with_a_remedy(motion):
    with pytest.raises(ConfigError, match="steps are too few") as fault:
        takes(motion, 1, steps=5)
    assert "generate.seconds" in fault.value.hint


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize(
    ("key", "value"),
    [("ease", [0.5, 0.2]), ("ease", [0, 2]), ("from_above", {"pace": 1.0}), ("from_above", 3)],
)
def test_what_is_no_range_is_refused_with_its_key(motion, key, value):
    with pytest.raises(ConfigError, match=key):
        load_config("lite", [f"generate.motions=[{{name: {motion}, {key}: {value}}}]"], plugins())
