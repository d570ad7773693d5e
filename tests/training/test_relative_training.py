"""Relative actions in training: their statistics, what they make easy, and priors of the other kind."""

import numpy as np
import pytest
from training_material import TINY_ACT, FakeStore, make_demonstration

from geoprior.errors import DataError
from geoprior.options import Choice
from geoprior.policies.checkpoint import list_checkpoints, load_predictor, read_header
from geoprior.policies.normalise import Normaliser
from geoprior.sources.shards import ShardSource
from geoprior.training.config import ConditionConfig, PretrainConfig
from geoprior.training.data import Batches, features_of, statistics_of
from geoprior.training.machine import Machine
from geoprior.training.stages import Job, train

CHUNK = 4


def act(actions, **options):
    return Choice(name="act", options={**TINY_ACT.options, "actions": actions, **options})


@pytest.fixture
def source(fake_store):
    return ShardSource(fake_store)


def slow_rows(source, skip):
    """All valid actions of all chunks, one at a time."""
    for poses, actions in zip(source.poses, source.actions, strict=True):
        for time in range(len(poses)):
            for place in range(CHUNK):
                if time + skip * place < len(poses):
                    action = actions[min(time + skip * place + skip - 1, len(poses) - 1)].astype(float)
                    yield action - np.r_[poses[time, :3], np.zeros(5)]


@pytest.mark.parametrize("skip", [1, 2])
def test_statistics_are_over_the_valid_actions_of_all_chunks(source, skip):
    rows = np.array(list(slow_rows(source, skip)))
    found = statistics_of(source, actions="relative", chunk=CHUNK, skip=skip)
    np.testing.assert_allclose(found["action"].mean, rows.mean(0), atol=1e-6)
    np.testing.assert_allclose(found["action"].std, rows.std(0), atol=1e-6)
    assert found["action"].count == len(rows)
    assert found["pose"] == statistics_of(source)["pose"]


@pytest.mark.parametrize("skip", [1, 2])
def test_what_is_learned_has_these_statistics(source, skip):
    statistics = statistics_of(source, actions="relative", chunk=CHUNK, skip=skip)
    config = PretrainConfig(batch_size=50, skip=skip, prefetch=0, image_noise=0.0)
    normaliser = Normaliser(statistics, actions="relative")
    batches = Batches(source, features_of(source, CHUNK), normaliser, config, 0)
    rows = []
    for step in range(40):
        batch = batches.batch(step)
        rows.append(batch["action"][batch["valid"]][:, :2].numpy())
    learned = np.concatenate(rows)
    assert np.abs(learned.mean(0)).max() < 0.15
    assert np.abs(learned.std(0) - 1.0).max() < 0.15


def test_constant_velocity_is_one_answer_wherever_the_hand_is():
    """Hands at many places, all with one velocity: relative chunks are all alike, absolute ones are not."""
    episodes = []
    for index in range(6):
        episode = make_demonstration(index, steps=12)
        start = np.random.default_rng(index).uniform(-1.0, 1.0, 3)
        for poses, first in ((episode.pose, 0), (episode.action, 1)):
            poses[:, :3] = start + np.array([0.02, 0.01, -0.03]) * (first + np.arange(12))[:, None]
            poses[:, 7] = 0.0
        episodes.append(episode)
    source = ShardSource(FakeStore(episodes))
    spreads = {}
    for kind in ("absolute", "relative"):
        statistics = statistics_of(source, actions=kind, chunk=CHUNK)
        normaliser = Normaliser(statistics, actions=kind)
        config = PretrainConfig(batch_size=30, prefetch=0)
        batch = Batches(source, features_of(source, CHUNK), normaliser, config, 0).batch(0)
        whole = batch["valid"].all(dim=1)
        spreads[kind] = float(batch["action"][whole][..., :3].std(dim=0).max())
    assert spreads["relative"] < 1e-4
    assert spreads["absolute"] > 0.1


def trained(source, folder, choice, *, prior=None, epochs=4, condition=None, **options):
    config = PretrainConfig(epochs=epochs, batch_size=4, threads=1, precision="fp32", log_every=1, **options)
    condition = condition or ConditionConfig(init="prior" if prior else "scratch")
    train(config, Job("test", 0, condition, prior, folder), choice, source, Machine("cpu", "fp32", 1))
    return list_checkpoints(folder)[-1].path


def test_it_learns_and_commands_are_absolute(source, fake_store, tmp_path):
    choice = act("relative", dropout=0.0, kl_weight=1.0, trunk_norm="group")
    path = trained(source, tmp_path, choice, epochs=250, learning_rate=5e-3, image_noise=0.0)
    predictor = load_predictor(path)
    errors, moves = [], []
    for episode in fake_store.episodes:
        first = {name: frames[2:3] for name, frames in episode.images.items()}
        said = predictor.predict(episode.pose[2:3], first)[0, :, :2]
        errors.append(abs(said - episode.action[2 : 2 + CHUNK, :2]).max())
        moves.append(abs(episode.action[1 + CHUNK, :2] - episode.pose[2, :2]).max())
    assert np.mean(errors) < 0.35 * np.mean(moves)


@pytest.mark.parametrize("kind", ["new", "pretrained", "merged"])
def test_fine_tuning_goes_on_with_statistics_of_the_kind(source, tmp_path, kind):
    prior = trained(source, tmp_path / "prior", act("relative"))
    condition = ConditionConfig(init="prior", statistics=kind)
    others = ShardSource(
        FakeStore([make_demonstration(index, steps=7, offset=0.5) for index in range(10, 13)])
    )
    tuned = read_header(trained(others, tmp_path / kind, act("relative"), prior=prior, condition=condition))
    assert tuned.actions == "relative"
    ours = statistics_of(others, actions="relative", chunk=CHUNK)["action"]
    theirs = read_header(prior).statistics["action"]
    expected = {"new": ours.count, "pretrained": theirs.count, "merged": ours.count + theirs.count}
    assert tuned.statistics["action"].count == expected[kind]
    if kind == "new":
        assert tuned.statistics["action"] == ours


@pytest.mark.parametrize(("theirs", "ours"), [("absolute", "relative"), ("relative", "absolute")])
def test_a_prior_of_the_other_kind_is_refused(source, tmp_path, theirs, ours):
    prior = trained(source, tmp_path / "prior", act(theirs))
    for condition in (
        ConditionConfig(init="prior"),
        ConditionConfig(init="prior", weights="trunk", statistics="merged"),
    ):
        with pytest.raises(
            DataError, match=f"the prior's actions are {theirs}, this training's {ours}"
        ) as error:
            trained(source, tmp_path / "tuned", act(ours), prior=prior, condition=condition)
        assert f"set policy.actions to {theirs}" in error.value.hint
    trunk = ConditionConfig(init="prior", weights="trunk")
    assert trained(source, tmp_path / "trunk", act(ours), prior=prior, condition=trunk).exists()
