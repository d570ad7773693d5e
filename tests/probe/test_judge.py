"""Vision gain while a prior is trained: logged, and without a trace in the weights."""

import json
from functools import partial

import pytest

from geoprior.config import load_config
from geoprior.errors import ConfigError
from geoprior.files import sha256_file
from geoprior.hooks.manager import plugins
from geoprior.policies.checkpoint import list_checkpoints
from geoprior.probe import judge
from geoprior.probe.checkpoint import load_trained
from geoprior.probe.judge import make_vision_judge
from geoprior.probe.sight import from_metrics
from geoprior.stages import STAGES, Workplace
from geoprior.training.stages import pretrain

SMALL = (
    "cameras.height=32",
    "cameras.width=32",
    "generate.episodes=3",
    "generate.seconds=2",
    "policy.chunk=4",
    "policy.dim=16",
    "policy.heads=2",
    "policy.ffn=16",
    "policy.encoder_layers=1",
    "policy.trunk_width=8",
    "pretrain.epochs=6",
    "pretrain.batch_size=6",
    "pretrain.checkpoint_every=2",
    "pretrain.threads=1",
    "pretrain.source=endless",
    "pretrain.source.workers=0",
    "pretrain.probe_episodes=3",
)


@pytest.fixture(scope="module")
def config():
    return load_config("lite", (*SMALL, "pretrain.precision=bf16"), plugins())


def train(config, out, judge_maker=None):
    return pretrain(
        config.pretrain,
        policy=config.policy,
        seed=config.seed,
        data=out,
        generate=config.generate,
        cameras=config.cameras,
        out=out,
        judge=judge_maker,
    )


def maker(config):
    return partial(make_vision_judge, config.generate, config.cameras, config.seed, 3)


def log(folder):
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


@pytest.fixture(scope="module")
def judged(config, tmp_path_factory):
    out = tmp_path_factory.mktemp("judged")
    return out, train(config, out, maker(config))


def test_it_is_logged_at_every_checkpoint_and_told_at_the_end(judged):
    out, result = judged
    lines = [line for line in log(out) if "vision_gain" in line]
    assert [round(line["epoch"]) for line in lines] == [2, 4, 6]
    for line in lines:
        assert set(from_metrics(line)) == {"all", "pick", "place", "push"}
    assert from_metrics(result["metrics"]) == from_metrics(lines[-1])
    assert len({line["true_l1"] for line in lines}) == 3
    assert len({line["still_l1"] for line in lines}) == len({line["pose_only_l1"] for line in lines}) == 1


def test_the_weights_are_those_of_a_training_without_it(config, judged, tmp_path):
    train(config, tmp_path)
    assert "vision_gain" not in (tmp_path / "log.jsonl").read_text()
    ours, theirs = list_checkpoints(judged[0]), list_checkpoints(tmp_path)
    assert [one.epoch for one in ours] == [one.epoch for one in theirs] == [2, 4, 6]
    for one, other in zip(ours, theirs, strict=True):
        assert sha256_file(one.path) == sha256_file(other.path)


def test_what_is_logged_is_what_the_checkpoint_gives(config, judged):
    """In the same precision; the weights that are judged are those that are saved."""
    out, result = judged
    trained = load_trained(list_checkpoints(out)[-1].path)
    from geoprior.training.judge import Taught
    from geoprior.training.machine import Machine, arithmetic

    source = judge.fresh_episodes(config.generate, config.cameras, config.seed, 3).source
    taught = Taught(source, [0, 1], trained.header.features, trained.normaliser, 1)
    machine = Machine("cpu", "bf16", 1)
    with arithmetic(machine):
        found = from_metrics(
            make_vision_judge(config.generate, config.cameras, config.seed, 3, taught).measure(
                trained.policy, machine
            )
        )
    expected = from_metrics(result["metrics"])
    for motion, sight in found.items():
        assert sight.true == pytest.approx(expected[motion].true, rel=1e-5)
        assert sight.shuffled == pytest.approx(expected[motion].shuffled, rel=1e-5)


def test_a_training_that_is_done_makes_no_episodes(config, judged, monkeypatch):
    monkeypatch.setattr(judge, "fresh_episodes", lambda *_: pytest.fail("made episodes"))
    out, result = judged
    assert train(config, out, maker(config)) == result


def _stage(config, out):
    stage = next(stage for stage in STAGES if stage.name == "pretrain")
    return stage.run(config, Workplace(out, plugins()))


def test_a_blind_prior_ends_with_a_warning_that_says_what_to_do(config, tmp_path, capsys):
    result = _stage(config, tmp_path)
    said = capsys.readouterr().err
    assert said.count("warning: ") == 1
    assert "pretrain.epochs" in said
    assert "docs/prior.md" in said
    assert result["warning"] in said
    kept = json.loads((tmp_path / "checkpoints/pretrain/result.json").read_text())
    assert from_metrics(kept["metrics"])["all"].still > 0.0


def test_it_can_be_switched_off_and_changes_no_fingerprint(config, tmp_path, capsys):
    off = load_config("lite", (*SMALL, "pretrain.probe_episodes=0"), plugins())
    stage = next(stage for stage in STAGES if stage.name == "pretrain")
    on = load_config("lite", SMALL, plugins())
    assert stage.config(on) == stage.config(off)
    result = _stage(off, tmp_path)
    assert "warning" not in capsys.readouterr().err
    assert not from_metrics(result["metrics"])


def test_one_episode_is_refused_at_the_door():
    with pytest.raises(ConfigError, match=r"probe_episodes.*two at least, or 0"):
        load_config("lite", ("pretrain.probe_episodes=1",), plugins())


def test_where_the_gain_decides_when_to_end_it_must_be_measured_and_counts(config):
    until = (*SMALL, "pretrain.until_vision_gain=0.1")
    stage = next(stage for stage in STAGES if stage.name == "pretrain")
    one, other = (
        load_config("quickstart", (*until, f"pretrain.probe_episodes={count}"), plugins()) for count in (3, 4)
    )
    assert stage.config(one) != stage.config(other)
    with pytest.raises(ConfigError, match="nothing measures it"):
        load_config("quickstart", ("pretrain.probe_episodes=0", *until[:-2], until[-1]), plugins())
    with pytest.raises(ConfigError, match="not learned from any"):
        load_config(
            "same-environment", ("pretrain.checkpoint_every=1", "pretrain.until_vision_gain=1"), plugins()
        )
