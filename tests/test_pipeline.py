"""The pipeline's rules on small stages that write text; the real stages are in test_kill_and_resume.py."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from geoprior import hookimpl, pipeline
from geoprior.config import RunConfig
from geoprior.errors import ConfigError, DataError, NumericalError
from geoprior.hooks.manager import Plugins
from geoprior.pipeline import run_stages
from geoprior.run_folder import LOCK_FILE, open_run
from geoprior.stages import Stage


class Listener:
    def __init__(self):
        self.heard = []

    @hookimpl
    def geoprior_before_stage(self, event):
        self.heard.append(("before", event.stage))

    @hookimpl
    def geoprior_after_stage(self, event):
        self.heard.append(("after", event.stage))

    @hookimpl
    def geoprior_stage_failed(self, event):
        self.heard.append(("failed", event.stage, event.error))


class House:
    """Two stages, `first` and `second`; `second` reads what `first` wrote."""

    def __init__(self, monkeypatch, tmp_path):
        self.ran, self.said, self.listener = [], [], Listener()
        self.fault = None
        self.path = tmp_path / "run"
        self.plugins = Plugins()
        self.plugins.register(self.listener, name="listener", package="tests", version="1")
        stages = (
            Stage("first", "", (), ("one",), lambda c: {"seed": c.seed}, self.write("one/a.txt")),
            Stage(
                "second", "", ("first",), ("two.txt",), lambda c: {"aim": c.task.name}, self.write("two.txt")
            ),
        )
        monkeypatch.setattr(pipeline, "STAGES", stages)

    def write(self, name):
        def run(config, place):
            self.ran.append(name)
            path = place.path / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(f"{config.seed}")
            if self.fault is not None:
                raise self.fault
            return {"wrote": name}

        return run

    def run(self, *names, config=None, replace=False):
        self.ran.clear()
        self.said.clear()
        with open_run(self.path, config or RunConfig(), pipeline.STAGES, replace=replace) as folder:
            run_stages(folder, names or ("first", "second"), self.plugins, self.said.append)
        return list(self.ran)


@pytest.fixture
def house(monkeypatch, tmp_path):
    return House(monkeypatch, tmp_path)


BOTH = ["one/a.txt", "two.txt"]


def test_a_second_run_skips_what_is_done(house):
    assert house.run() == BOTH
    assert house.run() == []
    assert house.said == ["first: done before, skipped", "second: done before, skipped"]


def test_a_lost_output_is_made_again(house):
    house.run()
    (house.path / "two.txt").unlink()
    assert house.run() == ["two.txt"]


def test_a_shortened_output_is_made_again_and_what_reads_it_waits(house):
    house.run()
    (house.path / "one" / "a.txt").write_text("")
    with pytest.raises(DataError, match="outputs of first are missing or cut off"):
        house.run("second")
    assert house.run() == ["one/a.txt"]


def test_a_damaged_file_is_gone_when_its_stage_runs_and_the_stages_behind_it_stay(house, monkeypatch):
    """A stage that keeps what is there would else keep the half, and declare it good."""
    house.run()
    path = house.path / "one" / "a.txt"
    path.write_text("")
    seen = []
    write = house.write("one/a.txt")
    first, second = pipeline.STAGES

    def run(config, place):
        seen.append(path.exists())
        return write(config, place)

    monkeypatch.setattr(pipeline, "STAGES", (replace(first, run=run), second))
    assert house.run() == ["one/a.txt"]
    assert seen == [False]
    assert house.said == [
        "first: one/a.txt missing or cut off, made again",
        "second: done before, skipped",
    ]


def test_other_content_outside_of_the_run_folder_runs_a_stage_again(house, monkeypatch):
    first, second = pipeline.STAGES
    digests = {"a file": "1"}
    second = replace(second, outside=lambda _: digests)
    monkeypatch.setattr(pipeline, "STAGES", (first, second))
    assert house.run() == BOTH
    assert house.run() == []
    digests["a file"] = "2"
    assert house.run() == ["two.txt"]
    assert house.said == ["first: done before, skipped", "second: its inputs have changed, runs again"]


def test_what_is_missing_outside_of_the_run_folder_is_said_first(house, monkeypatch):
    def missing(_):
        raise DataError("it is not there")

    first, second = pipeline.STAGES
    monkeypatch.setattr(pipeline, "STAGES", (first, replace(second, outside=missing)))
    with pytest.raises(DataError, match="it is not there"):
        house.run()
    assert house.run("first") == ["one/a.txt"]


def test_a_file_that_is_an_output_by_itself_is_the_stages_to_mend(house, monkeypatch):
    house.run()
    (house.path / "two.txt").write_text("")
    first, second = pipeline.STAGES
    seen = []

    def run(config, place):
        seen.append((place.path / "two.txt").exists())
        (place.path / "two.txt").write_text("0")
        return {}

    monkeypatch.setattr(pipeline, "STAGES", (first, replace(second, run=run)))
    house.run()
    assert seen == [True]


def test_what_is_for_people_alone_starts_nothing_again(house, monkeypatch):
    first, second = pipeline.STAGES
    monkeypatch.setattr(pipeline, "STAGES", (replace(first, passes_on=("*.safetensors",)), second))
    house.run()
    path = house.path / "one" / "a.txt"
    path.unlink()
    assert house.run() == []
    (house.path / "stages" / "first.json").unlink()
    assert house.run() == ["one/a.txt"]
    assert house.said[-1] == "second: done before, skipped"


def test_the_run_file_says_who_made_each_stage(house, monkeypatch):
    house.run("first")
    monkeypatch.setattr(pipeline.provenance, "versions", lambda: {"geoprior": "9.9"})
    house.run()
    stages = json.loads((house.path / "run.json").read_text())["stages"]
    assert stages["first"]["made_by"]["versions"]["geoprior"] != "9.9"
    assert stages["second"]["made_by"]["versions"]["geoprior"] == "9.9"


def test_a_kill_before_the_run_file_is_written_is_mended(house):
    house.run()
    (house.path / "run.json").unlink()
    assert house.run() == []
    assert set(json.loads((house.path / "run.json").read_text())["stages"]) == {"first", "second"}


def test_another_config_in_the_same_folder_is_refused_and_nothing_is_lost(house):
    house.run()
    with pytest.raises(ConfigError, match="seed: 0 -> 1") as caught:
        house.run(config=RunConfig(seed=1))
    assert "--replace" in caught.value.hint
    assert (house.path / "one" / "a.txt").read_text() == "0"
    assert house.run() == []


def test_replace_runs_the_changed_stage_and_those_that_read_it(house):
    house.run()
    assert house.run(config=RunConfig(seed=1), replace=True) == BOTH
    assert (house.path / "one" / "a.txt").read_text() == "1"


def test_replace_leaves_stages_alone_that_do_not_depend_on_the_change(house):
    house.run()
    assert house.run(config=RunConfig(task="other"), replace=True) == ["two.txt"]


def test_a_key_that_no_stage_depends_on_changes_nothing(house):
    house.run()
    assert house.run(config=RunConfig(executor="serial")) == []


def test_a_stage_alone_needs_its_inputs(house):
    with pytest.raises(DataError, match="second reads what first writes") as caught:
        house.run("second")
    assert caught.value.hint == f"geoprior first --out {house.path}"


def test_a_failed_stage_keeps_its_files_and_goes_on(house):
    house.fault = NumericalError("the loss is not finite")
    with pytest.raises(NumericalError):
        house.run()
    assert (house.path / "one" / "a.txt").exists()
    assert ("failed", "first", "the loss is not finite") in house.listener.heard
    house.fault = None
    assert house.run() == BOTH
    assert house.said[0] == "first: goes on"


def test_an_interrupt_is_heard_and_not_swallowed(house):
    house.fault = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        house.run()
    assert ("failed", "first", "interrupted") in house.listener.heard


def test_hooks_hear_the_stages_that_ran_and_not_those_skipped(house):
    house.run("first")
    house.run()
    assert house.listener.heard == [
        ("before", "first"),
        ("after", "first"),
        ("before", "second"),
        ("after", "second"),
    ]


def test_the_run_file_names_versions_seed_machine_and_fingerprints(house):
    house.run()
    run = json.loads((house.path / "run.json").read_text())
    assert {"geoprior", "torch", "mujoco", "robosuite"} <= set(run["versions"])
    assert run["seed"] == 0
    assert run["machine"]["cores"] >= 1
    assert set(run["stages"]) == {"first", "second"}
    assert all(len(stage["fingerprint"]) == 64 for stage in run["stages"].values())


def test_a_raised_revision_runs_the_stage_again(house, monkeypatch):
    house.run()
    first, second = pipeline.STAGES
    raised = Stage(**{**vars(first), "revision": first.revision + 1})
    monkeypatch.setattr(pipeline, "STAGES", (raised, second))
    assert house.run()[0] == "one/a.txt"


def test_the_saved_config_is_the_one_that_ran(house):
    from geoprior.config import load_config
    from geoprior.hooks.manager import plugins

    house.run(config=RunConfig(seed=7))
    assert load_config(house.path / "config.yaml", (), plugins()).seed == 7


def test_a_folder_with_other_things_is_refused_untouched(house):
    house.path.mkdir()
    (house.path / "thesis.txt").write_text("years of work")
    with pytest.raises(DataError, match="not a run folder"):
        house.run()
    assert [file.name for file in house.path.iterdir()] == ["thesis.txt"]


def test_a_file_in_the_folders_place_is_refused(house):
    house.path.write_text("a file")
    with pytest.raises(DataError, match="is a file"):
        house.run()


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a file system that refuses even root")
def test_a_folder_that_nobody_may_write_to_is_refused(house):
    house.path = Path("/proc/geoprior")
    with pytest.raises(DataError, match=r"/proc/geoprior.*cannot be written"):
        house.run()


def test_a_path_that_cannot_be_made_is_refused(house, tmp_path):
    (tmp_path / "file").write_text("")
    house.path = tmp_path / "file" / "run"
    with pytest.raises(DataError, match="cannot be written"):
        house.run()


def test_two_at_once_in_one_folder_are_refused(house):
    house.path.mkdir()
    code = (
        "import fcntl, sys\n"
        "file = open(sys.argv[1], 'w'); fcntl.flock(file, fcntl.LOCK_EX)\n"
        "print('held', flush=True); sys.stdin.read()\n"
    )
    lock = str(house.path / LOCK_FILE)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code, lock], **pipes) as other:
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(DataError, match="another geoprior is at work"):
            house.run()
        other.stdin.close()
    assert house.run() == BOTH


@pytest.mark.parametrize("content", ["{", '{"stage": "first"}'])
def test_a_damaged_record_is_named(house, content):
    house.run()
    (house.path / "stages" / "first.json").write_text(content)
    with pytest.raises(DataError, match=r"first\.json"):
        house.run()


def test_a_plug_in_of_another_version_changes_the_fingerprint(house, monkeypatch):
    house.run("first")
    fake = SimpleNamespace(**{"primitive torus": "geoprior-torus 2"})
    monkeypatch.setattr(pipeline, "plugins_named", lambda part, plugins: vars(fake))
    assert house.run("first") == ["one/a.txt"]
    assert house.said == ["first: its inputs have changed, runs again"]
