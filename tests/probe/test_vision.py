import numpy as np
import pytest
import torch
from probe_material import CHUNK, HERE, Blind, Looking, features, normaliser_of, square_episodes

from geoprior.policies.normalise import Normaliser
from geoprior.probe.baselines import lessons_of
from geoprior.probe.episodes import MOMENTS, ProbeEpisodes
from geoprior.probe.vision import BATCH, VisionProbe
from geoprior.training.data import statistics_of
from geoprior.training.machine import Machine


@pytest.fixture
def episodes():
    return square_episodes()


def probe_of(episodes, **options):
    return VisionProbe(episodes, features(episodes), normaliser_of(episodes), **options)


def test_a_policy_that_does_not_look_gains_exactly_nothing(episodes):
    found = probe_of(episodes).measure(Blind(normaliser_of(episodes)), HERE, black=True)
    assert list(found) == ["all", "pick", "push"]
    for sight in found.values():
        assert sight.vision_gain == 0.0
        assert sight.vision_gain_se == 0.0
        assert sight.true == sight.shuffled == sight.black
        assert sight.true == pytest.approx(sight.still, rel=1e-5)


def test_a_policy_that_reads_the_object_from_the_image_gains(episodes):
    found = probe_of(episodes).measure(Looking(normaliser_of(episodes)), HERE, black=True)
    for sight in found.values():
        assert sight.true < 0.01 < sight.shuffled
        assert sight.true < sight.black
        assert sight.vision_gain == pytest.approx(sight.shuffled - sight.true)
        assert sight.vision_gain > 3.0 * sight.vision_gain_se > 0.0
        assert sight.true < min(sight.still, sight.pose_only)


def test_all_is_the_mean_over_episodes_and_the_error_is_theirs(episodes):
    probe = probe_of(episodes)
    policy = Looking(normaliser_of(episodes))
    found = probe.measure(policy, HERE)
    assert found["all"].true == pytest.approx((found["pick"].true + found["push"].true) / 2)
    own = np.arange(len(probe.rows))
    target = np.stack(
        [
            normaliser_of(episodes).normalise("action", episodes.source.actions[slot][row[1:]])
            for slot, row in zip(probe.rows.slots, probe.rows.steps, strict=True)
        ]
    )
    gains = []
    for slot in range(len(episodes)):
        mine = probe.rows.slots == slot
        errors = []
        for images in (probe.rows.partners, own):
            wrong = np.abs(probe.predict(policy, HERE, images) - target)[mine]
            errors.append(np.mean([w[v].mean() for w, v in zip(wrong, probe.rows.valid[mine], strict=True)]))
        gains.append(errors[0] - errors[1])
    assert found["all"].vision_gain == pytest.approx(np.mean(gains))
    assert found["all"].vision_gain_se == pytest.approx(np.std(gains, ddof=1) / np.sqrt(len(gains)))


def test_standing_still_is_right_where_nothing_moves(episodes):
    for pose in episodes.source.poses:
        pose[:] = pose[0]
    episodes.source.actions[:] = [pose.copy() for pose in episodes.source.poses]
    assert probe_of(episodes).measure(Blind(normaliser_of(episodes)), HERE)["all"].still == 0.0


def test_a_gripper_that_closes_counts_against_standing_still(episodes):
    before = probe_of(episodes).measure(Blind(normaliser_of(episodes)), HERE)["all"].still
    for action in episodes.source.actions:
        action[:, 7] = 1.0
    episodes.source.actions[0][:, 7] = 0.0
    after = probe_of(episodes).measure(Blind(normaliser_of(episodes)), HERE)["all"].still
    assert after > before


def test_what_is_said_after_the_end_does_not_count(episodes):
    class Rambling(Looking):
        def predict(self, observation):
            chunk = super().predict(observation)
            chunk[:, 3:] = 100.0
            return chunk

    for source in (episodes.source,):
        source.poses = [pose[:3] for pose in source.poses]
        source.actions = [action[:3] for action in source.actions]
    normaliser = normaliser_of(episodes)
    plain, rambling = (
        probe_of(episodes).measure(policy(normaliser), HERE)["all"].true for policy in (Looking, Rambling)
    )
    assert plain == rambling


def test_the_pose_alone_is_learned_where_it_tells(episodes):
    """Where the command is a linear map of the pose, the regressor needs no image."""
    source = episodes.source
    for pose, action in zip(source.poses, source.actions, strict=True):
        action[:, :2] = 0.3 * pose[:, :2] - 0.1 * pose[:, 2:3]
        action[:] = action[0]
        pose[:] = pose[0]
    normaliser = normaliser_of(episodes)
    lessons = lessons_of(source.poses, source.actions, normaliser, CHUNK, 1)
    found = probe_of(episodes, lessons=lessons).measure(Blind(normaliser), HERE)["all"]
    assert found.pose_only < 0.1 * found.still


def test_without_lessons_an_episode_is_predicted_from_the_others(episodes):
    """A pose that names the episode and nothing else would be learned by heart."""
    rng = np.random.default_rng(3)
    for pose in episodes.source.poses:
        pose[:, :2] = rng.uniform(size=2)
    normaliser = normaliser_of(episodes)
    lessons = lessons_of(episodes.source.poses, episodes.source.actions, normaliser, CHUNK, 1)
    by_heart = probe_of(episodes, lessons=lessons).measure(Blind(normaliser), HERE)["all"].pose_only
    by_others = probe_of(episodes).measure(Blind(normaliser), HERE)["all"].pose_only
    assert by_heart < by_others


def test_the_policy_is_asked_in_evaluation_mode_and_left_as_it_was(episodes):
    for training in (True, False):
        policy = Blind(normaliser_of(episodes)).train(training)
        probe_of(episodes).measure(policy, HERE)
        assert not any(policy.modes)
        assert policy.training is training


def test_every_batch_is_of_one_size():
    episodes = square_episodes(2 + BATCH // MOMENTS)
    sizes = []

    class Counting(Blind):
        def commands(self, observation):
            sizes.append(len(observation["pose"]))
            return super().commands(observation)

    probe_of(episodes).measure(Counting(normaliser_of(episodes)), HERE)
    assert set(sizes) == {BATCH}


def test_precision_is_the_machines(episodes):
    seen = []

    class Asking(Blind):
        def commands(self, observation):
            seen.append(torch.is_autocast_enabled("cpu"))
            assert not torch.is_grad_enabled()
            return super().commands(observation)

    for precision in ("fp32", "bf16"):
        probe_of(episodes).measure(Asking(normaliser_of(episodes)), Machine("cpu", precision, 1))
    assert seen == [False] * (len(seen) // 2) + [True] * (len(seen) // 2)


def test_episodes_are_read_where_they_stand_in_the_source():
    whole = square_episodes(12)
    some = ProbeEpisodes(whole.source, [3, 5, 8, 10], ["pick"] * 4, "some")
    whole.source.asked.clear()
    found = probe_of(some).measure(Looking(normaliser_of(whole)), HERE)
    assert {number for number, _ in whole.source.asked} == {3, 5, 8, 10}
    assert found["all"].true < 0.01


def test_actions_from_the_present_pose_are_judged_as_such():
    """Standing still is then a command of zero, whatever the pose, and a policy that looks still sees."""
    episodes = square_episodes()
    plain = features(episodes)
    statistics = statistics_of(episodes.source, actions="relative", chunk=CHUNK)
    normaliser = Normaliser(statistics, actions="relative")
    probe = VisionProbe(episodes, plain, normaliser)

    class Relative(Looking):
        def predict(self, observation):
            raw = self.commands(observation)[:, None].expand(-1, CHUNK, -1).numpy()
            return torch.from_numpy(normaliser.normalise_actions(self.pose(observation).numpy(), raw))

    class Still(Blind):
        def predict(self, observation):
            zero = np.zeros((len(observation["pose"]), CHUNK, 8), np.float32)
            zero[..., 3:] = self.pose(observation).numpy()[:, None, 3:]
            return torch.from_numpy(normaliser.normalise("action", zero))

    looking = probe.measure(Relative(normaliser), HERE)["all"]
    assert looking.true < 0.01 < looking.shuffled
    still = probe.measure(Still(normaliser), HERE)["all"]
    assert still.true == pytest.approx(still.still, rel=1e-5)
    assert still.still == pytest.approx(looking.still)
