import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from probe_material import FEATURES, seen, square

from geoprior.errors import DataError, NumericalError
from geoprior.geometry.camera import CamerasConfig
from geoprior.options import Choice
from geoprior.policies.normalise import normalise_images
from geoprior.policies.policy import Features
from geoprior.probe.aim import FIRST_STATE, Resets, aim_error, see_resets, unseen_states
from geoprior.sim.workers import Setup

RANGES = st.builds(
    lambda first, count: range(first, first + count), st.integers(0, 5_000_000), st.integers(1, 10**6)
)


@given(count=st.integers(1, 1000), used=st.lists(RANGES, max_size=4))
def test_states_that_are_aimed_on_are_used_by_nobody_else(count, used):
    states = unseen_states(count, used)
    assert len(states) == count
    assert states.start >= FIRST_STATE
    assert not any(set(states) & set(each) for each in used)


def test_usually_they_are_the_same():
    assert unseen_states(3, [range(20), range(1_000_000, 1_000_030)]) == range(4_000_000, 4_000_003)


def resets(count=10, **points):
    rng = np.random.default_rng(0)
    targets = np.round(rng.uniform(size=(count, 2)) * 28) / 28
    pose = np.zeros((count, 8), np.float32)
    pose[:, :2] = 0.5
    frames = np.stack([np.repeat(square(target)[..., None], 3, axis=2) for target in targets])
    return Resets(
        pose,
        {"hand": frames, "third": frames},
        {"object": np.column_stack([targets, targets[:, 0]]), **points},
    )


class Oracle:
    """Leads half of the way to what the third camera shows, and then all of it, and a little on if asked."""

    features, fps = FEATURES, 10.0

    def __init__(self, on=0.0):
        self.on = on

    def predict(self, pose, images):
        import torch

        target = seen(normalise_images(torch.from_numpy(images["third"]))).numpy()
        chunk = np.repeat(pose[:, None], 4, axis=1)
        for step, share in enumerate((0.5, 0.8, 1.0, 1.0 + self.on)):
            chunk[:, step, :2] = pose[:, :2] + share * (target - pose[:, :2])
        return chunk


class Still(Oracle):
    def predict(self, pose, images):
        return np.repeat(pose[:, None], 4, axis=1)


def test_a_policy_that_reads_the_object_aims_and_with_others_images_it_does_not():
    found = aim_error(Oracle(), resets())
    assert found["true_cm"] < 0.5
    assert found["shuffled_cm"] > 10.0
    assert found["still_cm"] > 10.0
    assert "contact_cm" not in found


def test_a_chunk_that_leads_past_the_object_is_judged_by_where_it_came_nearest():
    found = aim_error(Oracle(on=0.5), resets())
    assert found["true_cm"] > 5.0
    assert found["nearest_cm"] < 0.5
    assert found["nearest_shuffled_cm"] > 5.0


def test_a_policy_that_stays_is_as_far_as_it_was():
    found = aim_error(Still(), resets())
    assert found["true_cm"] == found["shuffled_cm"] == found["nearest_cm"] == found["still_cm"]


def test_a_point_of_contact_is_told_of_where_there_is_one():
    there = resets()
    far = aim_error(Oracle(), resets(contact=there.points["object"] + [0.1, 0.0, 0.0]))
    near = aim_error(Oracle(), resets(contact=there.points["object"]))
    assert near["contact_cm"] < 0.5 < far["contact_cm"] <= 10.0 + 0.5
    assert near["contact_shuffled_cm"] > near["contact_cm"]


def test_of_several_hands_the_nearest_counts():
    one = resets()
    two = Resets(np.hstack([one.pose + 5.0, one.pose]), one.images, one.points)

    class Both(Oracle):
        def predict(self, pose, images):
            return np.concatenate(
                [np.repeat(pose[:, None, :8], 4, axis=1), super().predict(pose[:, 8:], images)], axis=2
            )

    assert aim_error(Both(), two) == pytest.approx(aim_error(Oracle(), one))


def test_numbers_that_are_not_finite_are_told():
    class Broken(Oracle):
        def predict(self, pose, images):
            return super().predict(pose, images) * np.float32("nan")

    with pytest.raises(NumericalError, match="not finite"):
        aim_error(Broken(), resets())


CAMERAS = CamerasConfig(height=32, width=32)


def setup(task):
    return Setup(Choice(name="ur5e"), Choice(name=task), CAMERAS)


def test_resets_are_what_the_simulation_shows():
    found = see_resets(setup("pick"), 10, range(FIRST_STATE, FIRST_STATE + 4), FEATURES)
    again = see_resets(setup("pick"), 10, range(FIRST_STATE + 1, FIRST_STATE + 3), FEATURES)
    assert len(found) == 4
    for name in ("hand", "third"):
        assert found.images[name].shape == (4, 32, 32, 3)
        assert np.array_equal(found.images[name][1:3], again.images[name])
        assert found.images[name].std() > 0
    assert np.array_equal(found.pose[1:3], again.pose)
    assert np.array_equal(found.points["object"][1:3], again.points["object"])
    assert (np.abs(found.points["object"][:, :2]) < 0.2).all()
    assert len(np.unique(found.points["object"], axis=0)) == 4


def test_an_object_is_where_each_camera_sees_it():
    """What is red in the third view goes right and down as the place does."""
    found = see_resets(setup("pick"), 10, range(FIRST_STATE, FIRST_STATE + 6), FEATURES)
    images = found.images["third"].astype(float)
    red = np.clip(images[..., 0] - images[..., 1:].max(axis=3) - 20.0, 0.0, None)
    rows, columns = np.mgrid[:32, :32]
    for axis, pixels in enumerate((columns, rows)):
        middles = (red * pixels).sum(axis=(1, 2)) / red.sum(axis=(1, 2))
        assert np.corrcoef(found.places["third"][:, axis], middles)[0, 1] > 0.95
    assert found.places["hand"].shape == (6, 2)
    assert (np.abs(found.places["hand"]) < 0.3).all()


def test_a_push_begins_behind_the_cube_opposite_the_area():
    from geoprior.sim.tasks.push.world import CONTACT_DISTANCE

    found = see_resets(setup("push"), 10, [FIRST_STATE], FEATURES)
    from geoprior.sim.workers import environment

    env = environment(setup("push"), 10)
    env.reset(FIRST_STATE)
    cube, area = env.world.cube_position()[:2], env.world.transform_goal_to_workspace()[:2, 3]
    behind = found.points["contact"][0, :2]
    assert np.linalg.norm(behind - cube) == pytest.approx(CONTACT_DISTANCE)
    away, ahead = behind - cube, area - cube
    assert away @ ahead == pytest.approx(-np.linalg.norm(away) * np.linalg.norm(ahead))


@pytest.mark.parametrize(
    ("wanted", "parts"),
    [
        (Features(("hand", "wrist"), (32, 32), ("hand",), 4), ("'cameras'", "wrist", "third")),
        (Features(("hand", "third"), (32, 32), ("left", "right"), 4), ("'hands'", "left, right")),
        (Features(("hand", "third"), (64, 48), ("hand",), 4), ("'image size'", "64 x 48", "32 x 32")),
    ],
)
def test_another_body_is_refused(wanted, parts):
    with pytest.raises(DataError) as caught:
        see_resets(setup("pick"), 10, [FIRST_STATE], wanted)
    for part in parts:
        assert part in caught.value.message
    assert "--data" in caught.value.hint
