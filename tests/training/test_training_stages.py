"""The stages with ACT on shards: what they write, what is transferred, and what is refused."""

import json
import shutil

import numpy as np
import pytest
import torch
from training_material import SIZE, TINY_ACT, make_demonstration, write_demonstrations

from geoprior import hookimpl
from geoprior.errors import ConfigError, DataError
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.policies.checkpoint import list_checkpoints, load_checkpoint, load_predictor
from geoprior.policies.normalise import merge
from geoprior.shards.reader import EpisodeStore
from geoprior.sources.shards import ShardSource
from geoprior.synthesis.config import GenerateConfig
from geoprior.training.config import ConditionConfig, FinetuneConfig, PretrainConfig
from geoprior.training.data import statistics_of
from geoprior.training.loop import fit
from geoprior.training.stages import finetune, pretrain

COMMON = {"batch_size": 8, "threads": 1, "precision": "fp32", "log_every": 1}
BOTH = {"scratch": ConditionConfig(init="scratch"), "prior": ConditionConfig(init="prior")}


@pytest.fixture(scope="module")
def synthetic(tmp_path_factory):
    return write_demonstrations(tmp_path_factory.mktemp("synthetic") / "shards", count=6, offset=0.3)


@pytest.fixture(scope="module")
def prior(synthetic, tmp_path_factory):
    out = tmp_path_factory.mktemp("prior")
    config = PretrainConfig(epochs=4, checkpoint_every=2, **COMMON)
    pretrain_on(synthetic, config, policy=TINY_ACT, seed=3, out=out)
    return out


def pretrain_on(shards, config, **options):
    return pretrain(config, data=shards, generate=GenerateConfig(), cameras=CamerasConfig(), **options)


def tune(demos, prior, out, conditions, *, policy=TINY_ACT, seed=3, **options):
    config = FinetuneConfig(**{"epochs": 4, "conditions": conditions, **COMMON, **options})
    return finetune(config, policy=policy, seed=seed, demos=demos, prior=prior, out=out)


def header_and_tensors(folder):
    return load_checkpoint(list_checkpoints(folder)[-1].path)


def statistics_in(folder):
    return statistics_of(ShardSource(EpisodeStore(folder)))


def test_pretraining_leaves_what_the_contract_says(prior, synthetic):
    assert [checkpoint.epoch for checkpoint in list_checkpoints(prior)] == [2, 4]
    header, _ = header_and_tensors(prior)
    assert header.policy == plugins().resolve("policy", TINY_ACT)
    assert (header.features.cameras, header.features.image_size) == (("hand", "third"), (SIZE, SIZE))
    assert (header.features.chunk, header.features.pose_size, header.fps) == (4, 8, 10.0)
    assert header.statistics == statistics_in(synthetic)
    assert header.details["data"] == {"digest": EpisodeStore(synthetic).digest, "episodes": 6}
    assert header.details["transfer"] == {"init": "scratch"}
    assert (header.details["precision"], header.details["threads"]) == ("fp32", 1)
    assert {path.name for path in prior.iterdir()} == {
        "epoch-000002.json",
        "epoch-000002.safetensors",
        "epoch-000004.json",
        "epoch-000004.safetensors",
        "log.jsonl",
        "machine.json",
        "result.json",
    }


def test_a_checkpoint_runs_on_raw_observations(prior):
    predictor = load_predictor(list_checkpoints(prior)[-1].path)
    episode = make_demonstration(0)
    commands = predictor.predict(episode.pose[:2], {name: f[:2] for name, f in episode.images.items()})
    assert commands.shape == (2, 4, 8)
    np.testing.assert_allclose(np.linalg.norm(commands[..., 3:7], axis=-1), 1.0, atol=1e-6)


def test_it_learns_its_data(synthetic, tmp_path):
    """An overfit: the chunk at the first frame comes near the demonstration's."""
    options = dict(TINY_ACT.options, dropout=0.0, kl_weight=1.0, trunk_norm="group")
    config = PretrainConfig(epochs=200, learning_rate=5e-3, image_noise=0.0, **{**COMMON, "log_every": 100})
    policy = Choice(name="act", options=options)
    result = pretrain_on(synthetic, config, policy=policy, seed=0, out=tmp_path)
    assert result["metrics"]["l1"] < 0.25
    predictor = load_predictor(list_checkpoints(tmp_path)[-1].path)
    errors, moves = [], []
    for index in range(6):
        episode = make_demonstration(index, steps=6 + index, offset=0.3)
        first = {name: frames[:1] for name, frames in episode.images.items()}
        said = predictor.predict(episode.pose[:1], first)[0, :, :2]
        errors.append(abs(said - episode.action[:4, :2]).max())
        moves.append(abs(episode.action[3, :2] - episode.pose[0, :2]).max())

    assert np.mean(errors) < 0.35 * np.mean(moves)


@pytest.mark.parametrize(("frame_cache_mb", "again"), [(1, 0), (0, 1)])
def test_frames_are_kept_as_far_as_the_config_allows(demos, tmp_path, monkeypatch, frame_cache_mb, again):
    """Two conditions draw the same samples: the second reads nothing new."""
    read, frames = [], EpisodeStore.frames
    monkeypatch.setattr(
        EpisodeStore, "frames", lambda *arguments: read.append(str(arguments[1:])) or frames(*arguments)
    )
    conditions = {name: ConditionConfig(init="scratch") for name in ("one", "two")}
    tune(demos, None, tmp_path, conditions, epochs=2, frame_cache_mb=frame_cache_mb)
    assert len(read) >= len(set(read)) * (1 + again)
    assert (len(read) == len(set(read))) == (not again)


def test_every_condition_and_seed_gets_its_folder(demos, prior, tmp_path):
    results = tune(demos, prior, tmp_path, BOTH, seeds=[0, 7], checkpoint_every=2)
    assert set(results) == {"scratch-s0", "scratch-s7", "prior-s0", "prior-s7"}
    for name, result in results.items():
        assert [c.epoch for c in list_checkpoints(tmp_path / name)] == [2, 4]
        assert (result["steps"], result["samples"]) == (3, 24)
        assert np.isfinite(list(result["metrics"].values())).all()
    again = tune(demos, prior, tmp_path, BOTH, seeds=[0, 7], checkpoint_every=2)
    assert again == results


@pytest.mark.parametrize("statistics", ["pretrained", "merged"])
def test_statistics_of_other_hands_are_refused(demos, prior, tmp_path, statistics):
    copy = shutil.copytree(prior, tmp_path / "prior")
    for path in copy.glob("epoch-*.json"):
        tree = json.loads(path.read_text())
        tree["features"]["hands"] = ["left"]
        path.write_text(json.dumps(tree))
    conditions = {"prior": ConditionConfig(init="prior", weights="trunk", statistics=statistics)}
    with pytest.raises(DataError, match="its statistics are of the hands left, this data has hand"):
        tune(demos, copy, tmp_path / "out", conditions, epochs=2)


def test_an_interrupted_stage_goes_on(demos, prior, tmp_path):
    class Interrupt:
        armed = True

        @hookimpl
        def geoprior_train_step(self, event):
            if event.run == "finetune/prior-s0" and event.step == 2 and self.armed:
                self.armed = False
                raise KeyboardInterrupt

    whole = tune(demos, prior, tmp_path / "whole", BOTH)
    plugins()._manager.register(Interrupt(), name="interrupt")
    try:
        with pytest.raises(KeyboardInterrupt):
            tune(demos, prior, tmp_path / "cut", BOTH, resume_seconds=0.0)
    finally:
        plugins()._manager.unregister(name="interrupt")
    assert (tmp_path / "cut" / "scratch-s0" / "result.json").exists()
    cut = tune(demos, prior, tmp_path / "cut", BOTH, resume_seconds=0.0)
    for name, result in whole.items():
        assert cut[name]["metrics"] == result["metrics"]
        for path in (tmp_path / "whole" / name).glob("epoch-*"):
            assert path.read_bytes() == (tmp_path / "cut" / name / path.name).read_bytes()


def test_conditions_are_paired_and_seeds_are_not(demos, prior, tmp_path, monkeypatch):
    """The same samples in the same order, and the same first weights where none are transferred."""
    seen, first = {}, {}

    def watch(training):
        name = training.folder.name
        seen[name] = [training.batches.batch(step)["pose"].clone() for step in range(2)]
        first[name] = {key: tensor.clone() for key, tensor in training.policy.state_dict().items()}
        return fit(training)

    monkeypatch.setattr("geoprior.training.stages.fit", watch)
    trunk_only = ConditionConfig(init="prior", weights="trunk")
    tune(demos, prior, tmp_path, {**BOTH, "trunk": trunk_only}, seeds=[0, 1])
    for other in ("prior-s0", "trunk-s0"):
        assert all(torch.equal(a, b) for a, b in zip(seen["scratch-s0"], seen[other], strict=True))
    assert not torch.equal(seen["scratch-s0"][0], seen["scratch-s1"][0])
    _, pretrained = header_and_tensors(prior)
    for name, tensor in first["scratch-s0"].items():
        assert torch.equal(first["prior-s0"][name], pretrained[name])
        expected = pretrained[name] if name.startswith("trunk.") else tensor
        assert torch.equal(first["trunk-s0"][name], expected)
    head = "action_head.weight"
    assert not torch.equal(first["scratch-s0"][head], first["scratch-s1"][head])


def test_what_becomes_of_weights_and_statistics_is_written_down(demos, prior, synthetic, tmp_path):
    kinds = ("pretrained", "new", "merged")
    conditions = {kind: ConditionConfig(init="prior", statistics=kind) for kind in kinds}
    tune(demos, prior, tmp_path, conditions, epochs=1)
    old, new = statistics_in(synthetic), statistics_in(demos)
    expected = {"pretrained": old, "new": new, "merged": merge(old, new)}
    for kind in kinds:
        header, tensors = header_and_tensors(tmp_path / f"{kind}-s0")
        assert header.statistics == expected[kind]
        transfer = header.details["transfer"]
        assert (transfer["init"], transfer["weights"], transfer["statistics"]) == ("prior", "all", kind)
        assert transfer["tensors"] == len(tensors)
        assert (transfer["prior"]["epoch"], transfer["prior"]["data"]) == (4, EpisodeStore(synthetic).digest)


def test_scratch_needs_no_prior(demos, tmp_path):
    tune(demos, None, tmp_path, {"scratch": BOTH["scratch"]}, epochs=1)
    header, _ = header_and_tensors(tmp_path / "scratch-s0")
    assert header.details["transfer"] == {"init": "scratch"}


def test_a_prior_that_is_missing(demos, tmp_path):
    with pytest.raises(ConfigError, match="condition 'prior' begins from a prior and none is given"):
        tune(demos, None, tmp_path / "out", BOTH)
    with pytest.raises(DataError, match="no checkpoint of pretraining is here"):
        tune(demos, tmp_path / "empty", tmp_path / "out", {"prior": BOTH["prior"]})


@pytest.mark.parametrize(
    ("layout", "options", "message"),
    [
        ({"cameras": ("hand", "top")}, {}, "trained on the cameras hand, third, this data has hand, top"),
        ({"fps": 20.0}, {}, "the prior acts 10 times a second, this training 20 times"),
        ({}, {"skip": 2}, "the prior acts 10 times a second, this training 5 times"),
        ({}, {"policy": Choice(name="act", options={**TINY_ACT.options, "ffn": 8})}, "linear1"),
        (
            {},
            {"policy": Choice(name="act", options={**TINY_ACT.options, "vae_layers": 2})},
            "lacks the tensor",
        ),
    ],
)
def test_a_prior_that_does_not_fit(prior, tmp_path, layout, options, message):
    demos = write_demonstrations(tmp_path / "demos", count=2, **layout)
    with pytest.raises(DataError, match=message):
        tune(demos, prior, tmp_path / "out", {"prior": BOTH["prior"]}, **options)


def test_a_skip_of_two_makes_half_the_rate(prior, tmp_path):
    fast = write_demonstrations(tmp_path / "fast", count=2, fps=20.0)
    tune(fast, prior, tmp_path / "out", {"prior": BOTH["prior"]}, skip=2, epochs=1)
    assert header_and_tensors(tmp_path / "out" / "prior-s0")[0].fps == 10.0


def test_another_config_in_the_same_folder_is_refused(demos, tmp_path):
    scratch = {"scratch": BOTH["scratch"]}
    tune(demos, None, tmp_path, scratch)
    with pytest.raises(DataError, match="of a training with another config"):
        tune(demos, None, tmp_path, scratch, learning_rate=0.5)
    with pytest.raises(DataError, match="of a training with another config"):
        tune(demos, None, tmp_path, scratch, seed=4)
    # What only tells how fast or how loud it goes is no other config; a new seed or condition joins.
    tune(demos, None, tmp_path, scratch, prefetch=0, log_every=50, resume_seconds=1.0, seeds=[0, 1])


def test_the_log_has_one_line_a_step(demos, tmp_path):
    tune(demos, None, tmp_path, {"scratch": BOTH["scratch"]})
    lines = [json.loads(line) for line in (tmp_path / "scratch-s0" / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines] == [1, 2, 3]
    assert {"loss", "l1", "kl"} <= lines[0].keys()


def test_held_out_episodes_are_left_out_of_statistics_and_count(synthetic, tmp_path):
    config = PretrainConfig(epochs=4, checkpoint_every=2, held_out=0.3, **COMMON)
    result = pretrain_on(synthetic, config, policy=TINY_ACT, seed=3, out=tmp_path)
    header, _ = header_and_tensors(tmp_path)
    assert header.details["data"]["episodes"] == 4
    assert header.statistics != statistics_in(synthetic)
    lines = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert [line["step"] for line in lines if "held_out_l1" in line] == [1, 2]
    assert {"held_out_loss", "held_out_l1", "held_out_kl"} <= set(result["metrics"])
