"""`geoprior plugins new`: what is written installs, keeps its contract, and is listed."""

from __future__ import annotations

import ast
import json
import tomllib
from pathlib import Path

import pytest
import yaml

from geoprior.authoring.scaffold.write import next_commands, write_package
from geoprior.config import QUICKSTART, load_config
from geoprior.errors import ConfigError, DataError
from geoprior.hooks.manager import GROUP, HOOK_OF_KIND, Plugins

KINDS = tuple(HOOK_OF_KIND)


@pytest.fixture(scope="module")
def builtins():
    found = Plugins()
    found.load_builtins()
    return found


@pytest.fixture(scope="module")
def packages(tmp_path_factory, builtins):
    """A new package of each kind, by kind."""
    out = tmp_path_factory.mktemp("new")
    return {kind: write_package(f"our-{kind}", kind, out, builtins) for kind in KINDS}


@pytest.fixture(scope="module")
def installed(environment, packages):
    """The environment, into which all of them are installed."""
    environment.do("pip", "install", *packages.values())
    return environment


@pytest.mark.parametrize("kind", KINDS)
def test_the_metadata_name_the_module_under_the_group(packages, kind):
    project = tomllib.loads((packages[kind] / "pyproject.toml").read_text())["project"]
    assert project["name"] == f"geoprior-our-{kind}"
    assert project["entry-points"][GROUP] == {f"our-{kind}": f"geoprior_our_{kind}"}
    assert project["dependencies"] == ["geoprior"]


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_of_the_template_is_left(packages, kind):
    files = [path for path in packages[kind].rglob("*") if path.is_file()]
    for path in files:
        text = path.read_text()
        for word in ("my_plugin", "my-plugin", "MyPlugin", "MY_PLUGIN", "scaffold", "{{", "}}"):
            assert word not in text, path
        if path.suffix == ".py":
            tree = ast.parse(text)
            assert ast.get_docstring(tree)
    assert {"pyproject.toml", "README.md", "__init__.py", "test_contract.py"} <= {path.name for path in files}


@pytest.mark.parametrize("kind", KINDS)
def test_the_readme_says_how_a_config_gets_it(packages, kind, builtins):
    """The setting names a key that is there, of this kind: an unknown name of it is what is complained of."""
    (line,) = [line for line in (packages[kind] / "README.md").read_text().splitlines() if "--set" in line]
    setting = line.split("--set")[1].strip(" '")
    assert yaml.safe_load(setting.split("=")[1]) in (f"our-{kind}", [f"our-{kind}"])
    with pytest.raises(ConfigError, match=f"unknown {kind} 'our-{kind}'"):
        load_config(QUICKSTART, [setting], builtins)


def test_the_three_commands_are_said(packages):
    folder = packages["primitive"]
    install, check, test = next_commands(folder)
    assert install == f"pip install -e {folder}"
    assert check == "geoprior plugins check geoprior-our-primitive"
    assert test == f"pytest {folder}"


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("Mug", "'mug'"),
        ("my_mug", "'my-mug'"),
        ("2-mugs", "'mugs'"),
        ("mug--cup", "'mug-cup'"),
        ("mug/../cup", "'mug-cup'"),
        ("-", "letters"),
        ("", "letters"),
        ("class", "letters"),
    ],
)
def test_a_name_that_cannot_be_one_is_refused(tmp_path, builtins, name, near):
    with pytest.raises(ConfigError) as caught:
        write_package(name, "primitive", tmp_path, builtins)
    assert near in caught.value.hint
    assert list(tmp_path.iterdir()) == []


def test_a_name_that_is_taken_is_refused_and_its_owner_is_named(tmp_path, builtins):
    with pytest.raises(ConfigError, match="primitive 'sphere' is taken by package 'geoprior'"):
        write_package("sphere", "primitive", tmp_path, builtins)
    assert write_package("sphere", "motion", tmp_path, builtins).is_dir()


def test_a_name_whose_module_is_there_already_is_refused(tmp_path, builtins, monkeypatch):
    (tmp_path / "geoprior_mug.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match="'geoprior-mug' is installed already"):
        write_package("mug", "primitive", tmp_path / "out", builtins)


def test_an_unknown_kind_is_refused(tmp_path, builtins):
    with pytest.raises(ConfigError, match="'cup' is no kind") as caught:
        write_package("mug", "cup", tmp_path, builtins)
    assert "primitive, motion" in caught.value.hint


def test_nothing_is_overwritten(tmp_path, builtins):
    folder = write_package("geoprior-mug", "primitive", tmp_path, builtins)
    assert folder.name == "geoprior-mug"
    (folder / "README.md").write_text("mine")
    with pytest.raises(DataError, match="is there already"):
        write_package("mug", "motion", tmp_path, builtins)
    assert (folder / "README.md").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["geoprior-mug"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_write_that_fails_leaves_nothing(tmp_path, builtins, kind, monkeypatch):
    def full(*_):
        raise OSError("no space left")

    monkeypatch.setattr(Path, "rename", full)
    with pytest.raises(DataError, match="no space left"):
        write_package("mug", kind, tmp_path, builtins)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_each_is_listed_with_what_it_adds(installed):
    listed = {
        plugin["package"]: plugin
        for plugin in json.loads(installed.do("geoprior", "plugins", "list", "--json"))
    }
    for kind, hook in HOOK_OF_KIND.items():
        plugin = listed[f"geoprior-our-{kind}"]
        assert (plugin["status"], plugin["hooks"]) == ("ok", [hook])
        assert [(offer["kind"], offer["name"]) for offer in plugin["offers"]] == [(kind, f"our-{kind}")]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_passes_the_check_and_its_own_tests(installed, packages, kind):
    content = json.loads(installed.do("geoprior", "plugins", "check", f"geoprior-our-{kind}", "--json"))
    assert (content["package"], content["version"], content["failed"]) == (f"geoprior-our-{kind}", "0.1.0", 0)
    assert {finding["status"] for finding in content["findings"]} == {"ok"}
    assert "passed" in installed.do("pytest", "-q", "-p", "no:cacheprovider", packages[kind])


RUN = """
extends: lite
cameras: {height: 32, width: 32}
executor: {name: our-executor, workers: 1}
robot: our-robot
task: our-task
policy: {name: our-policy, chunk: 4, width: 8, hidden: 16}
generate:
  episodes: 4
  seconds: 2
  motions: [our-motion]
  primitives: [our-primitive]
  variants: [our-variant]
  renderer: our-renderer
pretrain: {source: our-source, epochs: 2, batch_size: 2, precision: fp32}
demos: {episodes: 1}
finetune: {epochs: 2, batch_size: 1, checkpoint_every: 2, precision: fp32}
evaluate: {trials: 1, time_limit: 0.5, look: our-look}
"""


@pytest.mark.slow
def test_a_run_of_nothing_but_new_plug_ins_changes_no_line_of_geoprior(installed, tmp_path):
    """Primitive, motion, robot, policy and all the others, from the geometric data to the report."""
    for kind in KINDS:
        (record,) = installed.site.glob(f"geoprior_our_{kind}-*.dist-info/RECORD")
        files = [line.split(",")[0] for line in record.read_text().splitlines()]
        assert all(file.startswith(f"geoprior_our_{kind}") for file in files), files
    config = tmp_path / "ours.yaml"
    config.write_text(RUN)
    installed.do("geoprior", "run", config, "--out", tmp_path / "run")
    assert (tmp_path / "run" / "report" / "index.html").is_file()
    run = json.loads((tmp_path / "run" / "run.json").read_text())
    assert {plugin["package"] for plugin in run["plugins"]} == {f"geoprior-our-{kind}" for kind in KINDS}
    installed.do("geoprior", "shards", "verify", tmp_path / "run/shards/synthetic")
