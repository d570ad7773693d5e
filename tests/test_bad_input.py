"""What goes wrong at a user's keyboard, through the real command line: a sentence, a remedy, an exit code."""

import os
import shutil
import subprocess
import sys

import pytest


def geoprior(*arguments, **environment):
    return subprocess.run(
        [sys.executable, "-m", "geoprior", *map(str, arguments)],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def assert_sentence(done, code, *parts):
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert "error: " in done.stderr
    for part in parts:
        assert part in done.stderr


@pytest.fixture
def run(tiny_run, tmp_path):
    """A finished run of one's own, to be harmed."""
    return shutil.copytree(tiny_run, tmp_path / "run")


def digest(folder):
    return {
        str(path.relative_to(folder)): path.stat().st_size for path in folder.rglob("*") if path.is_file()
    }


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("generate.episods=3", ("'episods'", "did you mean 'episodes'")),
        ("generate.episodes=few", ("generate.episodes", "found 'few'")),
        ("generate.episodes=0", ("generate.episodes", "greater than or equal to 1")),
        ("generate.primitives=[sfere]", ("unknown primitive 'sfere'", "did you mean 'sphere'")),
        ("generate.motions=[pik]", ("unknown motion 'pik'", "did you mean 'pick'")),
        ("robot=ur5", ("unknown robot 'ur5'", "did you mean 'ur5e'")),
        ("policy=akt", ("unknown policy 'akt'", "choices: act")),
    ],
)
def test_a_wrong_config_ends_with_2_and_makes_no_folder(tmp_path, override, parts):
    done = geoprior("run", "lite", "--out", tmp_path / "run", "--set", override)
    assert_sentence(done, 2, "hint: ", *parts)
    assert not (tmp_path / "run").exists()


def test_a_foreign_folder_ends_with_4_and_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    assert_sentence(geoprior("run", "--out", tmp_path), 4, "not a run folder", "choose another --out")
    assert list(digest(tmp_path)) == ["thesis.txt"]


def test_a_folder_that_cannot_be_made_ends_with_4(tmp_path):
    (tmp_path / "file").write_text("")
    assert_sentence(geoprior("run", "--out", tmp_path / "file" / "run"), 4, "cannot be written")


def test_another_config_in_a_finished_folder_ends_with_2_and_loses_nothing(run):
    before = digest(run)
    done = geoprior("run", "--out", run, "--set", "seed=5")
    assert_sentence(done, 2, "seed: 1 -> 5", "--replace")
    assert digest(run) == before


@pytest.mark.parametrize(
    ("pattern", "stage", "maker"),
    [
        ("shards/synthetic/*.tar", "pretrain", "generate"),
        ("shards/demos/*.tar", "finetune", "demos"),
        ("checkpoints/pretrain/epoch-000006.safetensors", "finetune", "pretrain"),
        pytest.param(
            "checkpoints/finetune/prior-s0/epoch-000008.safetensors",
            "evaluate",
            "finetune",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_file_cut_off_ends_with_4_and_the_command_that_is_named_mends_it(run, pattern, stage, maker):
    path = next(iter(sorted(run.glob(pattern))))
    whole = path.read_bytes()
    os.truncate(path, path.stat().st_size // 2)
    (run / "stages" / f"{stage}.json").unlink()
    assert_sentence(geoprior(stage, "--out", run), 4, f"outputs of {maker}", f"geoprior {maker} --out {run}")
    mended = geoprior(maker, "--out", run)
    assert mended.returncode == 0, mended.stderr
    assert f"{maker}: {path.relative_to(run)} missing or cut off, made again" in mended.stderr
    assert path.read_bytes() == whole


def test_a_damaged_byte_of_a_shard_is_found_by_verify(run):
    path = next(iter(sorted(run.glob("shards/synthetic/*.tar"))))
    content = bytearray(path.read_bytes())
    place = content.index(b"IDAT") + 6
    content[place] ^= 0xFF
    path.write_bytes(content)
    done = geoprior("shards", "verify", run / "shards" / "synthetic")
    assert_sentence(done, 4, "faults")
    assert path.name in done.stdout


def test_a_checkpoint_of_the_right_size_with_wrong_content_ends_with_4(run):
    path = run / "checkpoints/finetune/prior-s0/epoch-000008.safetensors"
    path.write_bytes(b"\xff" * path.stat().st_size)
    (run / "stages" / "evaluate.json").unlink()
    (run / "rollouts.jsonl").unlink()
    assert_sentence(geoprior("evaluate", "--out", run), 4, path.name, "hint: ")


def test_no_gl_ends_with_5_and_the_apt_line(tmp_path):
    done = geoprior("run", "--out", tmp_path / "run", MUJOCO_GL="glfw")
    assert_sentence(done, 5, "MUJOCO_GL=glfw", "hint: ")
    assert not (tmp_path / "run").exists()


def test_what_renders_nothing_needs_no_gl(tmp_path):
    """A machine that trains alone may have none."""
    small = [word for key in ("episodes=1", "seconds=1") for word in ("--set", f"generate.{key}")]
    done = geoprior("generate", "lite", "--out", tmp_path / "run", *small, MUJOCO_GL="glfw")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run/shards/synthetic/manifest.json").exists()


def test_a_wrong_mujoco_ends_with_5_and_the_pip_line(tmp_path):
    """A package's metadata that claims another version, found before the real one."""
    metadata = tmp_path / "mujoco-3.10.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: mujoco\nVersion: 3.10.0\n")
    done = geoprior("run", "--out", tmp_path / "run", PYTHONPATH=str(tmp_path))
    assert_sentence(done, 5, "mujoco: 3.10.0 is installed", "pip install 'geoprior[sim]'")


@pytest.mark.parametrize(
    "episode", ["no/such/folder", "{run}/shards/synthetic:pick-999999", "{run}/shards/synthetic:99"]
)
def test_an_episode_that_is_not_there_ends_with_a_sentence(tiny_run, tmp_path, episode):
    done = geoprior("view", episode.format(run=tiny_run), "--out", tmp_path)
    assert done.returncode in (2, 4)
    assert_sentence(done, done.returncode)
    assert list(tmp_path.iterdir()) == []
