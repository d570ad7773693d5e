"""What is removed before a stage runs again with another config."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from geoprior.config import load_config
from geoprior.errors import DataError
from geoprior.hooks.manager import plugins
from geoprior.run_folder import RunFolder, clear, sweep
from geoprior.stages import Stage

STAGE = Stage("train", "", (), ("checkpoints/train", "log.txt"), lambda _: {}, lambda *_: {})


@pytest.fixture
def run(tmp_path):
    for name in (
        "checkpoints/train/epoch-000006",
        "checkpoints/train/result",
        "log.txt",
        "stages/train.json",
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("old")
    return RunFolder(tmp_path, load_config("lite", (), plugins()))


def test_record_and_outputs_go_and_nothing_else(run):
    (run.path / "checkpoints/other").mkdir()
    clear(run, STAGE)
    left = sorted(str(path.relative_to(run.path)) for path in run.path.rglob("*"))
    assert left == ["checkpoints", "checkpoints/other", "stages"]


def test_a_kill_while_clearing_leaves_no_old_file_where_new_ones_come(run, monkeypatch):
    def killed(path):
        raise KeyboardInterrupt(path)

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "rmtree", killed)
        with pytest.raises(KeyboardInterrupt):
            clear(run, STAGE)
    assert not (run.path / "checkpoints/train").exists()
    assert not (run.path / "stages/train.json").exists()
    sweep(run, STAGE)
    assert list((run.path / "checkpoints").iterdir()) == []


def test_a_kill_before_the_record_goes_leaves_nothing_in_the_outputs_place(run, monkeypatch):
    def killed(path, **_):
        raise KeyboardInterrupt(path)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", killed)
        with pytest.raises(KeyboardInterrupt):
            clear(run, STAGE)
    assert (run.path / "stages/train.json").exists()
    assert not (run.path / "checkpoints/train").exists()


def test_halves_of_files_are_swept_and_nothing_else(run):
    halves = [
        "checkpoints/train/.epoch-000007.safetensors.77.tmp",
        "checkpoints/train/deep/.x.webm.77.tmp.webm",
        ".log.txt.77.tmp",
    ]
    kept = ["checkpoints/train/.hidden", ".log.txt.mine", ".other.77.tmp"]
    for name in halves + kept:
        (run.path / name).parent.mkdir(exist_ok=True)
        (run.path / name).write_text("half")
    sweep(run, STAGE)
    assert not any((run.path / name).exists() for name in halves)
    assert all((run.path / name).exists() for name in kept)
    assert (run.path / "log.txt").exists()


def test_a_link_to_a_folder_elsewhere_is_refused_and_nothing_is_lost(run, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("disk")
    (elsewhere / "epoch-000006").write_text("old")
    shutil.rmtree(run.path / "checkpoints/train")
    (run.path / "checkpoints/train").symlink_to(elsewhere)
    with pytest.raises(DataError, match="checkpoints/train: a link to"):
        clear(run, STAGE)
    assert (elsewhere / "epoch-000006").exists()
    assert (run.path / "stages/train.json").exists()
    assert (run.path / "log.txt").exists()
