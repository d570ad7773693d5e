"""`geoprior probe` on a finished run, and at a user's keyboard."""

import json
import shutil
import subprocess
import sys

import pytest
from click.testing import CliRunner

from geoprior.cli import cli
from geoprior.errors import ConfigError, DataError
from geoprior.probing import Wanted, probe_checkpoint

MEASURES = {"true", "shuffled", "black", "still", "pose_only", "vision_gain", "vision_gain_se"}
PRIOR = "checkpoints/pretrain/epoch-000006.safetensors"
TUNED = "checkpoints/finetune/prior-s0/epoch-000008.safetensors"


def probe(*arguments):
    return CliRunner().invoke(cli, ["probe", *map(str, arguments)], catch_exceptions=False)


@pytest.fixture
def copy(tiny_run, tmp_path):
    return shutil.copytree(tiny_run, tmp_path / "run")


def test_json_is_the_object_that_is_promised(tiny_run):
    done = probe(tiny_run / PRIOR, "--episodes", 3, "--states", 4, "--json")
    found = json.loads(done.stdout)
    assert set(found) == {"motions", "aim", "linear_probe_cm"}
    assert list(found["motions"]) == ["all", "pick", "place", "push"]
    for sight in found["motions"].values():
        assert set(sight) == MEASURES
        assert sight["vision_gain"] == pytest.approx(sight["shuffled"] - sight["true"])
        assert all(isinstance(value, float) for value in sight.values())
    assert {"true_cm", "shuffled_cm", "nearest_cm"} <= set(found["aim"])
    assert set(found["linear_probe_cm"]) == {"hand", "third"}
    again = json.loads(probe(tiny_run / PRIOR, "--episodes", 3, "--states", 4, "--json").stdout)
    assert again == found


def test_for_people_it_begins_with_a_sentence(tiny_run):
    done = probe(tiny_run / PRIOR, "--episodes", 3, "--no-aim")
    assert done.stdout.startswith("This policy ")
    assert "3 fresh synthetic episodes of each motion" in done.stdout
    assert "aim error" not in done.stdout


def test_a_fine_tuned_policy_is_measured_on_demonstrations_and_it_is_said_that_it_saw_them(tiny_run):
    found = probe_checkpoint(tiny_run / TUNED, Wanted(states=12))
    assert list(found.motions) == ["all", "pick"]
    assert any("the training saw" in remark for remark in found.remarks)
    assert found.aim is not None
    assert set(found.linear_probe_cm or {}) == {"hand", "third"}
    unaimed = probe_checkpoint(tiny_run / TUNED, Wanted(states=0))
    assert unaimed.aim is None
    assert unaimed.linear_probe_cm is None, "demonstrations do not say where the object is"
    assert unaimed.motions == found.motions


def test_other_data_is_taken_as_it_is(tiny_run):
    found = probe_checkpoint(tiny_run / PRIOR, Wanted(data=tiny_run / "shards/demos", states=0))
    assert list(found.motions) == ["all", "pick"]
    assert any("not the training's" in remark for remark in found.remarks)


def test_without_a_run_data_must_be_given(tiny_run, tmp_path):
    for file in (tiny_run / PRIOR, (tiny_run / PRIOR).with_suffix(".json")):
        shutil.copy(file, tmp_path)
    alone = tmp_path / "epoch-000006.safetensors"
    with pytest.raises(ConfigError, match=r"no config\.yaml of a run") as caught:
        probe_checkpoint(alone)
    assert "--data FOLDER" in caught.value.hint
    found = probe_checkpoint(alone, Wanted(data=tiny_run / "shards/synthetic"))
    assert found.aim is None
    assert any("no run's config" in remark for remark in found.remarks)


def edit(checkpoint, change):
    file = checkpoint.with_suffix(".json")
    tree = json.loads(file.read_text())
    change(tree)
    file.write_text(json.dumps(tree))


@pytest.mark.parametrize(
    ("key", "value", "parts"),
    [
        ("fps", 7.0, ("'fps'", "10 time steps a second", "7 times")),
    ],
)
def test_another_rate_is_refused(copy, key, value, parts):
    edit(copy / PRIOR, lambda tree: tree.update({key: value}))
    with pytest.raises(DataError) as caught:
        probe_checkpoint(copy / PRIOR, Wanted(states=0))
    for part in parts:
        assert part in caught.value.message


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("cameras: {height: 64, width: 64}", ("'image size'", "64 x 64", "32 x 32")),
        ("hands", ("'cameras'", "arm")),
    ],
)
def test_data_of_another_kind_is_refused(copy, override, parts):
    if override == "hands":
        edit(copy / PRIOR, lambda tree: tree["features"].update(cameras=["arm", "third"]))
    else:
        text = (
            (copy / "config.yaml")
            .read_text()
            .replace("height: 32", "height: 64")
            .replace("width: 32", "width: 64")
        )
        (copy / "config.yaml").write_text(text)
    with pytest.raises(DataError) as caught:
        probe_checkpoint(copy / PRIOR, Wanted(states=0))
    for part in (*parts, str(copy / PRIOR)):
        assert part in caught.value.message
    assert "--data" in caught.value.hint


def test_demonstrations_that_are_gone_are_asked_for(copy):
    shutil.rmtree(copy / "shards/demos")
    with pytest.raises(ConfigError, match="not in its run") as caught:
        probe_checkpoint(copy / TUNED)
    assert "--data" in caught.value.hint


def test_a_damaged_checkpoint_and_a_foreign_file_end_with_4_and_a_sentence(copy):
    (copy / PRIOR).write_bytes(b"cut off")
    (copy / "notes.txt").write_text("")
    for path, part in (
        (copy / PRIOR, "cut off or changed"),
        (copy / "notes.txt", "not a checkpoint of geoprior"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "geoprior", "probe", str(path)],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 4
        assert part in done.stderr
        assert str(path) in done.stderr
        assert "hint: " in done.stderr
        assert "Traceback" not in done.stderr


def test_one_episode_is_refused_by_the_command_line(tiny_run):
    done = probe(tiny_run / PRIOR, "--episodes", 1)
    assert done.exit_code == 2
    assert "--episodes" in done.stderr


def test_a_machine_without_gl_gives_no_aim_and_says_why(tiny_run, monkeypatch):
    from geoprior.errors import MachineError
    from geoprior.probe import checkpoint

    def fail(*_):
        raise MachineError("OpenGL: no library", "apt-get install it")

    monkeypatch.setattr(checkpoint, "see_resets", fail)
    found = probe_checkpoint(tiny_run / PRIOR, Wanted(episodes=2))
    assert found.aim is None
    assert any("OpenGL" in remark for remark in found.remarks)
