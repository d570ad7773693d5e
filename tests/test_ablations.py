"""The paper's four ablations: presets that differ from the paper's config in what they say, and work."""

from __future__ import annotations

import itertools
import shlex
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from geoprior.cli import cli
from geoprior.config import load_config
from geoprior.config_tree import differences, find_config, packaged_configs, read_tree
from geoprior.errors import ConfigError
from geoprior.executors.local import SerialExecutor
from geoprior.hooks.manager import plugins
from geoprior.shards.reader import EpisodeStore
from geoprior.shards.verify import verify
from geoprior.synthesis.generate import generate

ROOT = Path(__file__).parents[1]
CHANGES = {
    "black-images": {"generate.variants"},
    "random-motion": {"generate.motions", "generate.episodes"},
    "no-hand-cube": {"generate.variants"},
    "spheres-only": {"generate.primitives"},
}
"""What each preset changes of the paper's config."""

SMALL = (
    "cameras={height: 96, width: 96}",
    "generate.fps=10",
    "pretrain.skip=1",
    "generate.seconds=1",
    "generate.episodes=6",
)


def load(name, *overrides):
    return load_config(name, overrides, plugins())


def changes(base, other):
    lines = differences(base.model_dump(mode="json"), other.model_dump(mode="json"))
    return {line.split(":")[0] for line in lines}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """``made(name)``: a few small episodes of a config."""

    def make(name):
        config = load(name, *SMALL)
        out = tmp_path_factory.mktemp("made")
        generate(config.generate, config.cameras, seed=0, executor=SerialExecutor(), out=out)
        assert list(verify(out)) == []
        return EpisodeStore(out)

    return make


def test_the_paper_has_four():
    assert {name for name in packaged_configs() if name.startswith("ablations/")} == {
        f"ablations/{name}" for name in CHANGES
    }


@pytest.mark.parametrize("name", CHANGES)
def test_a_preset_differs_from_the_papers_config_in_what_it_says_and_nothing_else(name):
    assert changes(load("paper"), load(f"ablations/{name}")) == CHANGES[name]


def names(choices):
    return [choice.name for choice in choices]


@pytest.mark.parametrize(
    ("name", "field", "said"),
    [
        ("black-images", "variants", ["black-images"]),
        ("random-motion", "motions", ["random-walk"]),
        ("no-hand-cube", "variants", ["no-hand-cube"]),
        ("spheres-only", "primitives", ["sphere"]),
    ],
)
def test_what_each_preset_says(name, field, said):
    assert names(getattr(load(f"ablations/{name}").generate, field)) == said


@pytest.mark.parametrize("name", [*CHANGES, None])
def test_each_data_set_has_the_papers_600_episodes(name):
    config = load(f"ablations/{name}" if name else "paper").generate
    assert config.episodes * len(config.motions) == 600


@pytest.mark.parametrize("name", CHANGES)
def test_the_command_in_the_comment_makes_the_same_change_to_lite(name):
    path = find_config(f"ablations/{name}")
    lines = [line.removeprefix("#   ") for line in path.read_text().splitlines() if line.startswith("#   ")]
    (command,) = lines
    words = shlex.split(command)
    assert words[:3] == ["geoprior", "run", "lite"]
    overrides = [after for word, after in itertools.pairwise(words) if word == "--set"]
    changed, base = load("lite", *overrides), load("lite")
    assert changes(base, changed) == CHANGES[name]
    preset = load(f"ablations/{name}")
    for field in ("variants", "motions", "primitives", "episodes"):
        if f"generate.{field}" in CHANGES[name]:
            assert getattr(changed.generate, field) == getattr(preset.generate, field)


@pytest.mark.parametrize("name", CHANGES)
def test_another_config_can_be_changed_by_the_keys_of_a_preset(name, tmp_path):
    own = dict(read_tree(find_config(f"ablations/{name}"))["generate"])
    keys = {key.removeprefix("generate.") for key in CHANGES[name]}
    mine = tmp_path / "mine.yaml"
    mine.write_text(f"extends: lite\ngenerate: { {key: own[key] for key in keys} }\n")
    assert changes(load("lite"), load(mine)) == CHANGES[name]
    mine.write_text(f"extends: ablations/{name}\nseed: 5\n")
    assert changes(load(f"ablations/{name}"), load(mine)) == {"seed"}


@pytest.mark.parametrize("spelling", ["ablations/{}", "ablations/{}.yaml", "configs/ablations/{}.yaml"])
@pytest.mark.parametrize("name", CHANGES)
def test_a_preset_is_found_from_any_folder(name, spelling, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_config(spelling.format(name)) == packaged_configs()[f"ablations/{name}"]


@pytest.mark.parametrize("wrong", ["ablations/black-image", "ablation/spheres-only", "spheres"])
def test_the_message_for_an_unknown_config_lists_them(wrong):
    with pytest.raises(ConfigError, match="no such config file") as caught:
        find_config(wrong)
    for name in CHANGES:
        assert f"ablations/{name}" in caught.value.hint


def test_the_command_line_takes_them_by_name():
    shown = CliRunner().invoke(cli, ["config", "show", "ablations/no-hand-cube"])
    assert shown.exit_code == 0, shown.output
    assert "- name: no-hand-cube" in shown.output


@pytest.fixture(scope="module")
def paper(made):
    return made("paper")


def test_black_images_show_nothing_and_keep_the_poses(made, paper):
    black = made("ablations/black-images")
    assert black.keys == paper.keys
    for number in range(len(black)):
        episode, original = black.episode(number), paper.episode(number)
        np.testing.assert_array_equal(episode.pose, original.pose)
        for camera in ("hand", "third"):
            assert not episode.images[camera].any()
            assert original.images[camera].any()


def test_without_the_hand_cube_only_the_third_view_changes_and_only_gets_darker(made, paper):
    changed = made("ablations/no-hand-cube")
    assert changed.keys == paper.keys
    for number in range(len(changed)):
        episode, original = changed.episode(number), paper.episode(number)
        np.testing.assert_array_equal(episode.pose, original.pose)
        np.testing.assert_array_equal(episode.images["hand"], original.images["hand"])
        assert (episode.images["third"] <= original.images["third"]).all()
        darker = (episode.images["third"] < original.images["third"]).any(axis=(1, 2))
        assert darker.mean() > 0.5, "a cube may hide before what is white already, now and then"


def test_spheres_only_has_spheres_and_no_ellipsoids_in_all_three_motions(made):
    spheres = made("ablations/spheres-only")
    headers = [spheres.header(number) for number in range(len(spheres))]
    assert {header.motion for header in headers} == {"pick", "place", "push"}
    sizes = []
    for header in headers:
        assert header.details["primitive"]["name"] == "sphere"
        extents = header.details["object"]["extents"]
        np.testing.assert_allclose(extents, extents[0], rtol=0.01)
        sizes.append(extents[0])
    assert max(sizes) - min(sizes) > 0.03, "of many sizes"


def test_random_motion_has_random_walks_past_every_shape(made):
    walks = made("ablations/random-motion")
    headers = [walks.header(number) for number in range(len(walks))]
    assert {header.motion for header in headers} == {"random-walk"}
    assert len({header.details["primitive"]["name"] for header in headers}) > 2
    for number, header in enumerate(headers):
        assert header.details["marker"] is False
        assert header.details["object"]["position"] == header.details["object"]["final_position"]
        assert [name for name, _ in header.details["phases"]] == ["leg-1", "leg-2", "leg-3", "leg-4"]
        assert walks.episode(number).images["third"].any()


@pytest.mark.slow
def test_a_built_wheel_holds_them(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    for name in ("geoprior", "configs"):
        shutil.copytree(ROOT / name, source / name, symlinks=True)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy2(ROOT / name, source)
    build = ["wheel", "--quiet", "--no-deps", "--no-index", "--no-build-isolation", "--wheel-dir", tmp_path]
    subprocess.run([sys.executable, "-m", "pip", *map(str, build), source], check=True, capture_output=True)
    (wheel,) = tmp_path.glob("geoprior-*.whl")
    with zipfile.ZipFile(wheel) as packed:
        for name in packaged_configs():
            kept = (ROOT / "configs" / f"{name}.yaml").read_bytes()
            assert packed.read(f"geoprior/configs/{name}.yaml") == kept
        assert "geoprior/render/variants/black_images.py" in packed.namelist()
