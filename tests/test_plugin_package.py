"""Third-party packages, installed by pip and used by the command line."""

import json
import os
import shutil
import subprocess
import sys
from functools import lru_cache, partial
from pathlib import Path

import pytest
from command_line import geoprior

PACKAGES = Path(__file__).parents[1] / "plugins"
PACKAGE, ARM = PACKAGES / "geoprior-torus", PACKAGES / "geoprior-panda"
DIFFUSION, OBJECTS = PACKAGES / "geoprior-diffusion", PACKAGES / "geoprior-multiobject"
HANDS = PACKAGES / "geoprior-bimanual"
EVERY = (PACKAGE, ARM, DIFFUSION, OBJECTS, HANDS)
TORUS = (
    "--set", "generate.primitives=[torus]",
    "--set", "generate.episodes=2",
    "--set", "generate.seconds=1",
    "--set", "executor=serial",
)  # fmt: skip


@pytest.fixture(scope="module")
def site_with(tmp_path_factory):
    """Gives a folder with a package installed into it, as in somebody's environment."""
    return lru_cache(maxsize=None)(partial(_install, tmp_path_factory=tmp_path_factory))


@pytest.fixture
def site(site_with):
    """The folder with the torus."""
    return site_with(PACKAGE)


def _install(package: Path, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    source = tmp_path_factory.mktemp("source") / package.name
    shutil.copytree(package, source)
    install = [
        "install",
        "--quiet",
        "--no-deps",
        "--no-index",
        "--no-build-isolation",
        "--target",
        folder,
        source,
    ]
    subprocess.run([sys.executable, "-m", "pip", *map(str, install)], check=True, capture_output=True)
    return folder


def test_it_is_listed_with_its_package_version_and_hooks(site):
    plugins = json.loads(geoprior(site, "plugins", "list", "--json").stdout)
    (torus,) = [plugin for plugin in plugins if plugin["package"] == "geoprior-torus"]
    assert (torus["status"], torus["version"], torus["hooks"]) == ("ok", "0.1.0", ["geoprior_primitives"])
    assert torus["offers"] == [
        {"kind": "primitive", "name": "torus", "summary": "a ring that lies flat on the floor"}
    ]


def test_a_config_that_names_it_gets_it_and_the_run_says_where_it_came_from(site, tmp_path):
    done = geoprior(site, "generate", "lite", "--out", tmp_path / "run", *TORUS)
    assert done.returncode == 0, done.stderr
    info = json.loads(geoprior(site, "shards", "info", tmp_path / "run/shards/synthetic", "--json").stdout)
    assert info["episodes"] == 6
    run = json.loads((tmp_path / "run" / "run.json").read_text())
    assert run["plugins"] == [{"name": "torus", "package": "geoprior-torus", "version": "0.1.0"}]
    assert geoprior(site, "shards", "verify", tmp_path / "run/shards/synthetic").returncode == 0


def test_installing_it_changes_no_data_of_a_config_that_does_not_name_it(site, tmp_path):
    small = [word.replace("torus", "sphere") for word in TORUS]
    manifests = []
    for name, path in (("without", ""), ("with", site)):
        done = geoprior(path, "generate", "lite", "--out", tmp_path / name, *small)
        assert done.returncode == 0, done.stderr
        manifests.append((tmp_path / name / "shards/synthetic/manifest.json").read_bytes())
    assert manifests[0] == manifests[1]


def test_the_allow_list_keeps_it_out_and_says_so(site, tmp_path):
    done = geoprior(site, "generate", "--out", tmp_path / "run", *TORUS, GEOPRIOR_PLUGINS="somebody-else")
    assert done.returncode == 2
    assert "unknown primitive 'torus'" in done.stderr
    assert "torus (not allowed)" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("name", ["torus", "geoprior-torus"])
def test_the_allow_list_takes_names_of_entry_points_and_of_packages(name, site):
    done = geoprior(site, "plugins", "list", GEOPRIOR_PLUGINS=f"{name},typo")
    assert any(line.startswith("  torus ") for line in done.stdout.splitlines())
    assert "unknown: typo: in GEOPRIOR_PLUGINS, and not installed" in done.stdout


def test_an_arm_of_robosuite_is_a_module_of_a_few_lines(site_with, tmp_path):
    """The command line demonstrates a task with an arm that the package adds."""
    small = ("robot=panda", "task=push", "demos.episodes=1", "executor=serial")
    options = [word for each in small for word in ("--set", each)]
    done = geoprior(site_with(ARM), "demos", "lite", "--out", tmp_path / "run", *options)
    assert done.returncode == 0, done.stderr
    shards = tmp_path / "run" / "shards" / "demos"
    info = json.loads(geoprior(site_with(ARM), "shards", "info", shards, "--json").stdout)
    assert info["episodes"] == 1
    run = json.loads((tmp_path / "run" / "run.json").read_text())
    assert [plugin["package"] for plugin in run["plugins"]] == ["geoprior-panda"]
    assert len((ARM / "geoprior_panda.py").read_text().splitlines()) < 40


def test_another_policy_runs_from_the_geometric_data_to_the_report(site_with, tmp_path):
    """With the same command and one line of config; the prior's weights reach the fine-tuning."""
    tiny = (
        "cameras={height: 32, width: 32}",
        "generate.episodes=2",
        "generate.seconds=2",
        "policy.widths=[16, 32]",
        "policy.trunk_width=8",
        "pretrain.epochs=2",
        "demos.episodes=1",
        "finetune.epochs=2",
        "finetune.checkpoint_every=2",
        "finetune.conditions={prior: {init: prior}, trunk: {init: prior, weights: trunk}}",
        "evaluate.trials=1",
        "evaluate.time_limit=0.5",
        "executor=serial",
    )
    options = [word for each in tiny for word in ("--set", each)]
    run = tmp_path / "run"
    done = geoprior(site_with(DIFFUSION), "run", DIFFUSION / "diffusion.yaml", "--out", run, *options)
    assert done.returncode == 0, done.stderr
    assert (run / "report" / "index.html").exists()
    (checkpoint,) = (run / "checkpoints/finetune/prior-s0").glob("epoch-*.json")
    header = json.loads(checkpoint.read_text())
    assert header["policy"]["name"] == "diffusion"
    assert header["details"]["transfer"]["tensors"] > 0
    assert [plugin["name"] for plugin in json.loads((run / "run.json").read_text())["plugins"]] == [
        "diffusion"
    ]


def test_scenes_of_several_objects_are_generated_and_drawn_in_space(site_with, tmp_path):
    tiny = ("generate.episodes=2", "generate.seconds=2", "executor=serial")
    options = [word for each in tiny for word in ("--set", each)]
    config, run = OBJECTS / "multiobject.yaml", tmp_path / "run"
    done = geoprior(site_with(OBJECTS), "generate", config, "--out", run, *options)
    assert done.returncode == 0, done.stderr
    shards = run / "shards" / "synthetic"
    info = json.loads(geoprior(site_with(OBJECTS), "shards", "info", shards, "--json").stdout)
    assert info["episodes"] == 4
    assert geoprior(site_with(OBJECTS), "shards", "verify", shards).returncode == 0
    drawn = geoprior(
        site_with(OBJECTS), "view", f"{config}:stack-000001", "--3d", "--film", "none", "--out", tmp_path
    )
    assert drawn.returncode == 0, drawn.stderr
    assert (tmp_path / "stack-000001-3d.png").exists()


def test_every_package_here_is_tested():
    assert {path.parent for path in PACKAGES.glob("*/pyproject.toml")} == {
        PACKAGE,
        ARM,
        DIFFUSION,
        OBJECTS,
        HANDS,
    }


@pytest.mark.parametrize("package", [DIFFUSION, OBJECTS, HANDS])
def test_a_package_is_some_six_hundred_lines_and_says_how_it_is_used(package):
    lines = sum(len(path.read_text().splitlines()) for path in package.glob("geoprior_*/*.py"))
    assert lines <= 625
    (example,) = package.glob("*.yaml")
    assert example.name in (package / "README.md").read_text()


@pytest.mark.parametrize(
    "package", [PACKAGE, DIFFUSION, OBJECTS, HANDS, pytest.param(ARM, marks=pytest.mark.slow)]
)
def test_their_own_tests_pass(site_with, package):
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(package / "tests")]
    done = subprocess.run(
        command,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(str(site_with(each)) for each in EVERY),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_a_package_that_takes_a_built_in_name_stops_everything_and_both_are_named(tmp_path):
    (tmp_path / "rival.py").write_text(
        "from geoprior import PrimitiveSpec, hookimpl\n"
        "from geoprior.options import Options\n"
        "@hookimpl\n"
        "def geoprior_primitives():\n"
        "    yield PrimitiveSpec('sphere', 'another', Options, lambda config: None)\n"
    )
    metadata = tmp_path / "rival-2.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: rival\nVersion: 2.0\n")
    (metadata / "entry_points.txt").write_text("[geoprior]\nrival = rival\n")
    done = geoprior(tmp_path, "plugins", "list")
    assert done.returncode == 3
    assert "'sphere' is registered twice" in done.stderr
    assert "'geoprior'" in done.stderr
    assert "'rival'" in done.stderr
    assert "Traceback" not in done.stderr
