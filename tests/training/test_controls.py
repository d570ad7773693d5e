"""The controls of a comparison: what a condition takes of which prior, and what it does not."""

import json
import shutil

import numpy as np
import pytest
import torch
from training_material import TINY_ACT, FakeStore, make_demonstration, write_demonstrations

from geoprior.errors import ConfigError, DataError
from geoprior.geometry.camera import CamerasConfig
from geoprior.policies.checkpoint import list_checkpoints, load_checkpoint
from geoprior.policies.normalise import merge
from geoprior.shards.reader import EpisodeStore
from geoprior.sources.blind import BlindSource
from geoprior.sources.shards import ShardSource
from geoprior.synthesis.config import GenerateConfig
from geoprior.training.config import ConditionConfig, FinetuneConfig, PretrainConfig
from geoprior.training.data import statistics_of
from geoprior.training.loop import fit
from geoprior.training.priors import outside_digests
from geoprior.training.stages import finetune, pretrain

COMMON = {"batch_size": 8, "threads": 1, "precision": "fp32", "log_every": 1}
SCRATCH, PRIOR = ConditionConfig(init="scratch"), ConditionConfig(init="prior", statistics="pretrained")
BLIND = ConditionConfig(init="blind-prior", statistics="pretrained")
STATISTICS = ConditionConfig(init="scratch", statistics="pretrained")


@pytest.fixture(scope="module")
def synthetic(tmp_path_factory):
    return write_demonstrations(tmp_path_factory.mktemp("synthetic") / "shards", count=6, offset=0.3)


def pretrain_on(shards, out, *, blind):
    config = PretrainConfig(epochs=4, **COMMON)
    setting = {"generate": GenerateConfig(), "cameras": CamerasConfig()}
    pretrain(config, policy=TINY_ACT, seed=3, data=shards, out=out, blind=blind, **setting)
    return out


@pytest.fixture(scope="module")
def prior(synthetic, tmp_path_factory):
    return pretrain_on(synthetic, tmp_path_factory.mktemp("prior"), blind=True)


def tune(demos, prior, out, conditions, **options):
    config = FinetuneConfig(**{"epochs": 1, "conditions": conditions, **COMMON, **options})
    return finetune(config, policy=TINY_ACT, seed=3, demos=demos, prior=prior, out=out)


def last(folder):
    return load_checkpoint(list_checkpoints(folder)[-1].path)


def watch(monkeypatch):
    """The first weights of every training, by its folder's name."""
    first = {}

    def watched(training):
        first[training.folder.name] = {k: v.clone() for k, v in training.policy.state_dict().items()}
        return fit(training)

    monkeypatch.setattr("geoprior.training.stages.fit", watched)
    return first


def same(one, other):
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


def test_black_frames_and_all_else_as_it_is():
    seen = ShardSource(FakeStore([make_demonstration(index) for index in range(3)]))
    blind = BlindSource(seen)
    numbers, steps = np.array([0, 2, 4]), np.array([[0, 1], [3, 4], [8, 8]])
    there, here = seen.read(numbers, steps), blind.read(numbers, steps)
    assert any(frames.any() for frames in there.frames.values())
    for camera, frames in there.frames.items():
        assert (here.frames[camera].shape, here.frames[camera].dtype) == (frames.shape, frames.dtype)
        assert not here.frames[camera].any()
    np.testing.assert_array_equal(here.pose, there.pose)
    np.testing.assert_array_equal(here.action, there.action)
    assert statistics_of(blind) == statistics_of(seen)
    assert (len(blind), blind.cameras, blind.hands, blind.fps) == (3, seen.cameras, seen.hands, seen.fps)
    assert blind.image_size == seen.image_size
    assert blind.digest != seen.digest
    assert len(blind.digest) == 64


def test_a_blind_prior_has_seen_nothing(prior, synthetic, tmp_path, monkeypatch):
    """It begins as the sighted one does, and other images lead to the same weights."""
    first = watch(monkeypatch)
    sighted = pretrain_on(synthetic, tmp_path / "again", blind=True)
    assert same(first["again"], first["blind"])
    (header, weights), (seeing_header, seeing) = last(prior / "blind"), last(prior)
    assert header.statistics == seeing_header.statistics
    assert not same(weights, seeing)

    otherwise = write_demonstrations(tmp_path / "shards", count=6, offset=0.3, channels=1)
    monkeypatch.setattr(
        EpisodeStore,
        "frames",
        lambda self, i, camera, steps: np.full((len(steps), *self.image_size), 255, np.uint8),
    )
    pretrain_on(otherwise, tmp_path / "white", blind=True)
    assert same(last(tmp_path / "white" / "blind")[1], last(sighted / "blind")[1])
    assert not same(last(tmp_path / "white")[1], last(sighted)[1])


def test_without_being_asked_for_there_is_no_blind_prior_and_the_other_is_as_before(
    prior, synthetic, tmp_path
):
    alone = pretrain_on(synthetic, tmp_path, blind=False)
    assert not (alone / "blind").exists()
    assert same(last(alone)[1], last(prior)[1])


def test_each_condition_begins_from_what_it_says(demos, prior, tmp_path, monkeypatch):
    first = watch(monkeypatch)
    merged = ConditionConfig(init="scratch", statistics="merged")
    conditions = {"scratch": SCRATCH, "prior": PRIOR, "blind": BLIND, "same": STATISTICS, "mix": merged}
    tune(demos, prior, tmp_path, conditions)
    assert same(first["same-s0"], first["scratch-s0"])
    assert same(first["mix-s0"], first["scratch-s0"])
    assert same(first["prior-s0"], last(prior)[1])
    assert same(first["blind-s0"], last(prior / "blind")[1])
    pretrained, new = last(prior)[0].statistics, statistics_of(ShardSource(EpisodeStore(demos)))
    expected = {"scratch": new, "prior": pretrained, "blind": pretrained, "same": pretrained}
    for name, statistics in {**expected, "mix": merge(pretrained, new)}.items():
        assert last(tmp_path / f"{name}-s0")[0].statistics == statistics, name
    assert not same(last(tmp_path / "same-s0")[1], last(tmp_path / "scratch-s0")[1])
    said = last(tmp_path / "same-s0")[0].details["transfer"]
    assert said.keys() == {"init", "statistics", "prior"}
    assert last(tmp_path / "scratch-s0")[0].details["transfer"] == {"init": "scratch"}


@pytest.mark.parametrize("place", ["file", "folder", "run"])
def test_another_runs_prior_does_what_the_own_one_does(demos, prior, tmp_path, place):
    """To the byte, wherever it lies: its path stands in no checkpoint."""
    run = tmp_path / "run"
    shutil.copytree(prior, run / "checkpoints" / "pretrain")
    paths = {
        "file": list_checkpoints(run / "checkpoints" / "pretrain")[-1].path,
        "folder": run / "checkpoints" / "pretrain",
        "run": run,
    }
    outside = PRIOR.model_copy(update={"prior": str(paths[place])})
    tune(demos, prior, tmp_path / "own", {"prior": PRIOR})
    tune(demos, None, tmp_path / "outside", {"prior": outside})
    for path in (tmp_path / "own" / "prior-s0").glob("epoch-*"):
        assert path.read_bytes() == (tmp_path / "outside" / "prior-s0" / path.name).read_bytes()


def test_an_outside_prior_is_known_by_its_weights(prior, tmp_path):
    moved = shutil.copytree(prior, tmp_path / "elsewhere")

    def digests(path):
        return outside_digests({"a": SCRATCH, "b": PRIOR.model_copy(update={"prior": str(path)})})

    assert digests(moved) == digests(prior)
    assert digests(prior).keys() == {"b"}
    assert digests(prior / "blind") != digests(prior)


def test_an_outside_prior_that_cannot_be_taken(demos, prior, tmp_path):
    def take(path):
        conditions = {"theirs": PRIOR.model_copy(update={"prior": str(path)})}
        tune(demos, prior, tmp_path / "out", conditions)

    with pytest.raises(DataError, match=r"finetune\.conditions\.theirs\.prior: .*/no: no such file"):
        take(tmp_path / "no")
    with pytest.raises(DataError, match=r"finetune\.conditions\.theirs\.prior: .* holds no checkpoint"):
        take(demos)
    with pytest.raises(DataError, match="not a checkpoint of geoprior"):
        take(demos / "manifest.json")
    cut = shutil.copytree(prior, tmp_path / "cut")
    (path,) = cut.glob("epoch-*.json")
    path.write_text(json.dumps({"format": "another"}))
    with pytest.raises(DataError, match="not a checkpoint of geoprior"):
        take(cut)


def test_a_blind_prior_that_is_missing(demos, synthetic, tmp_path):
    sighted = pretrain_on(synthetic, tmp_path / "prior", blind=False)
    with pytest.raises(DataError, match="blind: no checkpoint of pretraining is here"):
        tune(demos, sighted, tmp_path / "out", {"blind": BLIND})
    with pytest.raises(ConfigError, match="condition 'same' begins from a prior and none is given"):
        tune(demos, None, tmp_path / "out", {"same": STATISTICS})


def test_statistics_alone_need_no_equal_rate(prior, tmp_path):
    """A chunk of other length in time matters to weights, not to means and spreads of poses."""
    fast = write_demonstrations(tmp_path / "fast", count=2, fps=20.0)
    tune(fast, prior, tmp_path / "out", {"same": STATISTICS})
    with pytest.raises(DataError, match="the prior acts 10 times a second"):
        tune(fast, prior, tmp_path / "out", {"blind": BLIND})
