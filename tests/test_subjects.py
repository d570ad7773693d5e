"""What an EPISODE on the command line names: one in shards, with its points or not, or one of a config."""

import os
import shutil
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from geoprior.cli import cli
from geoprior.config import load_config, to_yaml
from geoprior.errors import ConfigError, DataError
from geoprior.executors.local import SerialExecutor
from geoprior.hooks.manager import plugins
from geoprior.shards.golden import golden_episodes, write_golden
from geoprior.shards.writer import write_shard
from geoprior.subjects import find_subject
from geoprior.synthesis.generate import generate

SMALL = ("cameras.height=32", "cameras.width=32", "generate.seconds=0.8", "generate.episodes=2")


@pytest.fixture(scope="session")
def made_run(tmp_path_factory):
    """A run folder as far as its data set goes."""
    run = tmp_path_factory.mktemp("made") / "run"
    config = load_config("lite", SMALL, plugins())
    out = run / "shards" / "synthetic"
    generate(config.generate, config.cameras, seed=config.seed, executor=SerialExecutor(), out=out)
    (run / "config.yaml").write_text(to_yaml(config))
    return run


@pytest.fixture
def run(made_run, tmp_path):
    return shutil.copytree(made_run, tmp_path / "run")


@pytest.fixture
def config_file(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(to_yaml(load_config("lite", SMALL, plugins())))
    return path


@pytest.mark.parametrize("source", ["shards/synthetic", "shards/synthetic/synthetic-000000.tar"])
def test_a_runs_episode_comes_with_its_points(made_run, monkeypatch, source):
    monkeypatch.chdir(made_run.parent)
    subject = find_subject(f"run/{source}:push-000001", points=True)
    assert subject.remark == ""
    assert [cloud.body for cloud in subject.bodies.clouds] == ["floor", "object", "marker", "hand"]
    without = find_subject(f"run/{source}:push-000001")
    assert (without.bodies, without.remark) == (None, "")
    np.testing.assert_array_equal(without.episode.pose, subject.episode.pose)


def remark_of(run):
    subject = find_subject(f"{run / 'shards' / 'synthetic'}:push-000001", points=True)
    assert subject.bodies is None
    assert subject.remark.startswith("push-000001: drawn without points, which cannot be made again: ")
    assert "\n" not in subject.remark
    return subject.remark


def test_without_the_runs_config_there_is_a_remark_instead_of_points(run):
    (run / "config.yaml").unlink()
    assert "there is no config.yaml" in remark_of(run)


def test_with_another_config_there_is_a_remark_instead_of_points(run):
    text = (run / "config.yaml").read_text()
    (run / "config.yaml").write_text(text.replace("seed: 1\n", "seed: 2\n", 1))
    assert "would make another episode" in remark_of(run)


@pytest.mark.parametrize("text", ["seed: [", "sede: 1", "generate: {primitives: [torus-of-a-plug-in]}"])
def test_a_config_that_cannot_be_read_is_a_remark_not_an_error(run, text):
    (run / "config.yaml").write_text(text)
    assert "config.yaml" in remark_of(run)


def test_a_demonstration_has_no_points_and_needs_no_remark(tmp_path):
    episode = next(golden_episodes())
    demo = replace(episode, header=episode.header.model_copy(update={"source": "simulated"}))
    write_shard(tmp_path / "demo.tar", [demo])
    subject = find_subject(str(tmp_path / "demo.tar"), points=True)
    assert (subject.bodies, subject.remark) == (None, "")


@pytest.mark.parametrize("key", ["", ":2", ":push-000000"])
def test_a_configs_episode_is_on_no_disk(config_file, key):
    subject = find_subject(f"{config_file}{key}")
    assert subject.episode.header.key == ("push-000000" if key else "pick-000000")
    assert subject.bodies is not None
    assert sorted(path.name for path in config_file.parent.iterdir()) == ["small.yaml"]


def test_a_packaged_config_is_named_by_its_name():
    assert find_subject("quickstart:place-000004").episode.header.key == "place-000004"


def test_a_key_of_the_config_can_be_set(config_file):
    usual = find_subject(f"{config_file}:push-000000").episode
    other = find_subject(f"{config_file}:push-000000", ["generate.primitives=[sphere]"]).episode
    assert other.header.details["primitive"]["name"] == "sphere"
    assert other.header.details["recipe"] != usual.header.details["recipe"]


def test_what_is_on_the_disk_comes_before_a_packaged_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_golden(tmp_path / "quickstart")
    assert find_subject("quickstart:push-000001").episode.header.generator == "geoprior golden 1"


@pytest.mark.parametrize(
    ("text", "overrides", "error", "message", "hint"),
    [
        ("quikstart:push-000001", (), ConfigError, "quikstart: no such file or folder", "'quickstart'"),
        ("runs/none/shards", (), ConfigError, "runs/none/shards: no such file or folder", "packaged configs"),
        ("quickstart:shove-000001", (), ConfigError, "quickstart: no episode 'shove-000001'", "push"),
        ("quickstart:push-000100", (), ConfigError, "quickstart: no episode", "push-000099"),
        ("{small}:push-000002", (), ConfigError, "small.yaml: no episode 'push-000002'", "push-000001"),
        ("{small}", ("seeed=1",), ConfigError, "--set seeed=1: there is no key", "seed"),
        ("{golden}:push-000001", ("seed=1",), ConfigError, "--set changes a config", "leave out --set"),
        ("{golden}:push-000002", (), DataError, "no episode 'push-000002'", "did you mean"),
        ("{empty}", (), DataError, "no such file", ""),
        ("{text}", (), DataError, "", ""),
    ],
)
def test_what_is_not_there_is_named_with_a_remedy(
    config_file, tmp_path, text, overrides, error, message, hint
):
    write_golden(tmp_path / "golden")
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.tar").write_text("no tar")
    places = {"small": config_file, "golden": tmp_path / "golden", "empty": tmp_path / "empty"}
    with pytest.raises(error) as caught:
        find_subject(text.format(text=tmp_path / "notes.tar", **places), overrides, points=True)
    assert message in caught.value.message
    assert hint in caught.value.hint


def test_a_yaml_that_is_no_config_is_named(tmp_path):
    (tmp_path / "shopping.yaml").write_text("milk: 2")
    with pytest.raises(ConfigError, match=r"shopping\.yaml: key 'milk'"):
        find_subject(f"{tmp_path / 'shopping.yaml'}:push-000001")


def test_the_command_says_why_there_are_no_points_on_stderr_and_draws_nevertheless(run, tmp_path):
    (run / "config.yaml").unlink()
    episode = run / "shards" / "synthetic"
    done = CliRunner().invoke(
        cli, ["view", f"{episode}:0", "--3d", "--film", "none", "--out", str(tmp_path / "out")]
    )
    assert done.exit_code == 0
    assert done.stderr.count("\n") == 1
    assert "cannot be made again" in done.stderr
    assert sorted(os.listdir(tmp_path / "out")) == ["pick-000000-3d.png", "pick-000000.png"]  # noqa: PTH208
