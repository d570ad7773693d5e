"""Episodes that a training never sees, and the loss on them."""

from __future__ import annotations

import json
import time
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from training_material import TINY_ACT, FakeStore, make_demonstration, make_training

from geoprior.errors import ConfigError
from geoprior.policies.checkpoint import list_checkpoints, load_checkpoint
from geoprior.policies.normalise import Normaliser
from geoprior.sources.shards import ShardSource
from geoprior.training.config import ConditionConfig, PretrainConfig
from geoprior.training.data import Batches, features_of, split_slots, statistics_of
from geoprior.training.held_out import MOMENTS, HeldOut
from geoprior.training.loop import RESULT_NAME, fit
from geoprior.training.machine import Machine
from geoprior.training.stages import Job, build_policy, train


class Watched(FakeStore):
    """Remembers whose frames were read."""

    def __init__(self, episodes):
        super().__init__(episodes)
        self.seen = []

    def frames(self, i, camera, steps):
        self.seen.append((i, tuple(steps)))
        return super().frames(i, camera, steps)


@pytest.fixture
def store():
    return Watched([make_demonstration(index, steps=6 + index) for index in range(8)])


def _judged(store, folder, share=0.3, **options):
    """A training of the linear policy that holds some of the episodes out."""
    training = make_training(store, folder, **options)
    source = ShardSource(store)
    slots, aside = split_slots(len(store), share, training.seed)
    features, normaliser = features_of(source, 4), Normaliser(statistics_of(source, slots))
    return replace(
        training,
        batches=Batches(source, features, normaliser, training.config, training.seed, slots),
        episodes=len(slots),
        judges=[HeldOut(source, aside, features, normaliser, training.config)],
    ), set(aside)


def _lines(folder):
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


@given(count=st.integers(2, 300), share=st.floats(0.001, 0.9), seed=st.integers(0, 99))
def test_every_episode_is_on_one_side(count, share, seed):
    slots, aside = split_slots(count, share, seed)
    assert sorted(slots + aside) == list(range(count))
    assert slots
    assert aside
    assert abs(len(aside) - share * count) <= 1.0 or len(aside) == 1
    assert split_slots(count, 0.0, seed) == (list(range(count)), [])


def test_one_episode_cannot_be_on_both_sides():
    with pytest.raises(ConfigError, match="cannot be trained on and held out"):
        split_slots(1, 0.5, 0)


def test_no_sample_is_of_an_episode_that_is_held_out(store, tmp_path):
    training, aside = _judged(store, tmp_path, epochs=30)
    store.seen.clear()
    for step in range(training.steps):
        training.batches.batch(step)
    assert {episode for episode, _ in store.seen} == set(range(8)) - aside
    assert aside


def test_with_nothing_held_out_the_batches_are_what_they_were(store, tmp_path):
    source = ShardSource(store)
    whole = make_training(store, tmp_path)
    slots, _ = split_slots(len(store), 0.0, 0)
    features, normaliser = features_of(source, 4), Normaliser(statistics_of(source, slots))
    again = Batches(source, features, normaliser, whole.config, 0, slots)
    for step in range(5):
        for name, tensor in whole.batches.batch(step).items():
            assert torch.equal(again.batch(step)[name], tensor)


def test_moments_are_spread_over_each_episode(store, tmp_path):
    training, aside = _judged(store, tmp_path)
    store.seen.clear()
    training.judges[0].measure(training.policy, training.machine)
    for episode in aside:
        times = sorted({steps[0] for seen, steps in store.seen if seen == episode})
        assert len(times) == MOMENTS
        assert times[0] < len(store.pose(episode)) / 4
        assert times[-1] >= 3 * len(store.pose(episode)) / 4
    assert {episode for episode, _ in store.seen} == aside


def test_the_loss_is_a_mean_whatever_the_batch_size(store, tmp_path):
    measured = []
    for size in (1, 3, 100):
        training, _ = _judged(store, tmp_path, batch_size=size)
        training.policy.loss = _without_noise(training.policy)
        measured.append(training.judges[0].measure(training.policy, training.machine)["held_out_l1"])
    np.testing.assert_allclose(measured, measured[0], rtol=1e-5)


def _without_noise(policy):
    def loss(batch):
        assert not policy.training
        error = (policy.act(batch) - batch["action"]).abs().mean()
        return error, {"l1": error}

    return loss


def test_it_is_logged_at_every_checkpoint_and_falls(store, tmp_path):
    training, _ = _judged(store, tmp_path, epochs=90, learning_rate=0.02, checkpoint_every=30, log_every=1000)
    result = fit(training)
    lines = [line for line in _lines(tmp_path) if "held_out_l1" in line]
    assert len(lines) == 3
    losses = [line["held_out_l1"] for line in lines]
    assert losses[-1] < losses[0]
    assert result["metrics"]["held_out_l1"] == pytest.approx(losses[-1])
    assert training.policy.training


class Counting:
    """A judge that measures how often it was asked."""

    asked = 0

    def measure(self, policy, machine):
        assert machine.device == "cpu"
        self.asked += len(list(policy.parameters())) > 0
        return {"asked": float(self.asked)}


def test_several_judges_speak_at_every_checkpoint(store, tmp_path):
    training, _ = _judged(store, tmp_path, epochs=6, checkpoint_every=2, log_every=1000)
    result = fit(replace(training, judges=[*training.judges, Counting()]))
    lines = [line for line in _lines(tmp_path) if "asked" in line]
    assert [line["asked"] for line in lines] == [1.0, 2.0, 3.0]
    assert all("held_out_l1" in line for line in lines)
    assert result["metrics"]["asked"] == 3.0


@pytest.mark.parametrize("norm", ["frozen", "batch", "group"])
@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_the_weights_that_are_judged_are_those_of_the_checkpoint(store, tmp_path, precision, norm):
    """A trunk keeps what it derives from its weights, which an optimiser may change behind its back."""
    training, _ = _judged(
        store, tmp_path, epochs=9, checkpoint_every=3, learning_rate=0.01, precision=precision
    )
    choice = TINY_ACT.model_copy(update={"options": {**TINY_ACT.options, "trunk_norm": norm}})
    first, fresh = (build_policy(choice, training.policy.features, 0) for _ in range(2))
    fit(replace(training, policy=first))
    judged = [line["held_out_loss"] for line in _lines(tmp_path) if "held_out_loss" in line]
    assert len(set(judged)) == 3
    for checkpoint, loss in zip(list_checkpoints(tmp_path), judged, strict=True):
        fresh.load_state_dict(load_checkpoint(checkpoint.path)[1])
        assert training.judges[0].measure(fresh, training.machine)["held_out_loss"] == pytest.approx(
            loss, rel=1e-6
        )


def test_judging_changes_nothing_of_the_training(store, tmp_path):
    judged, _ = _judged(store, tmp_path / "a", checkpoint_every=2)
    unjudged = replace(_judged(store, tmp_path / "b", checkpoint_every=2)[0], judges=[])
    fit(judged)
    fit(unjudged)
    for name, tensor in judged.policy.state_dict().items():
        assert torch.equal(unjudged.policy.state_dict()[name], tensor)
    assert "held_out_l1" not in (tmp_path / "b" / RESULT_NAME).read_text()


class OneFile(ShardSource):
    """A source that cannot be read twice at a time, as one with one open file."""

    inside = 0

    def read(self, numbers, steps):
        OneFile.inside += 1
        try:
            assert OneFile.inside == 1, "read by two at a time"
            time.sleep(0.05)
            return super().read(numbers, steps)
        finally:
            OneFile.inside -= 1


@pytest.mark.parametrize("workers", [0, 2])
def test_a_source_is_read_by_one_at_a_time_though_loader_and_judge_both_read(workers, store, tmp_path):
    config = PretrainConfig(
        epochs=3,
        batch_size=2,
        checkpoint_every=1,
        held_out=0.3,
        prefetch=4,
        loader_workers=workers,
        threads=1,
        precision="fp32",
    )
    job = Job("test", 0, ConditionConfig(init="scratch"), None, tmp_path)
    result = train(config, job, TINY_ACT, OneFile(store), Machine("cpu", "fp32", 1))
    assert result["metrics"]["held_out_l1"] > 0.0
