"""A run folder may come from anyone: whatever it says, nothing outside of it is read, removed or replaced.

Every folder here is a sandbox with a decoy beside it.
"""

import json
import os

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geoprior import pipeline
from geoprior.config import RunConfig
from geoprior.errors import DataError, GeopriorError
from geoprior.files import write_bytes, write_json
from geoprior.hooks.manager import Plugins
from geoprior.pipeline import run_stages
from geoprior.run_folder import open_run
from geoprior.stages import Stage

DIGEST = "0" * 64


class Sandbox:
    """A run of two small stages, and a decoy folder beside it."""

    def __init__(self, monkeypatch, root):
        self.run, self.decoy = root / "run", root / "decoy"
        self.decoy.mkdir()
        for name in ("a.txt", "b.tar", ".half.1.tmp"):
            (self.decoy / name).write_text("years of work")
        self.stages = (
            Stage("first", "", (), ("one",), lambda c: {"seed": c.seed}, self.write("one/a.txt")),
            Stage("second", "", ("first",), ("two.txt",), lambda c: {}, self.write("two.txt")),
        )
        monkeypatch.setattr(pipeline, "STAGES", self.stages)

    def write(self, name):
        def run(config, place):
            path = place.path / name
            path.parent.mkdir(exist_ok=True)
            write_bytes(path, f"{config.seed}".encode())
            return {}

        return run

    def go(self, seed=0, *, replace=False):
        with open_run(self.run, RunConfig(seed=seed), self.stages, replace=replace) as folder:
            run_stages(folder, ("first", "second"), Plugins(), lambda line: None)

    def edit(self, stage, **changes):
        path = self.run / "stages" / f"{stage}.json"
        path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))

    def is_whole(self):
        return {path.name: path.read_text() for path in self.decoy.iterdir()} == dict.fromkeys(
            ("a.txt", "b.tar", ".half.1.tmp"), "years of work"
        )


@pytest.fixture
def sandbox(monkeypatch, tmp_path):
    return Sandbox(monkeypatch, tmp_path)


@pytest.mark.parametrize("stage", ["first", "second"])
@pytest.mark.parametrize(
    "name",
    ["{decoy}/a.txt", "../decoy/a.txt", "one/../../decoy/b.tar", "..", "/", "", "one/\0", "./../decoy/a.txt"],
)
def test_a_record_that_names_what_lies_elsewhere_is_refused(sandbox, stage, name):
    sandbox.go()
    sandbox.edit(stage, outputs={name.format(decoy=sandbox.decoy): {"bytes": 1, "sha256": DIGEST}})
    with pytest.raises(DataError, match="does not lie in the run folder"):
        sandbox.go()
    assert sandbox.is_whole()


@pytest.mark.parametrize("name", ["config.yaml", "two.txt", "stages/second.json", ".lock", "one"])
def test_a_stage_removes_only_what_it_could_have_written(sandbox, name):
    """The record of `first` names a file of another stage, or of the run, with a wrong size."""
    sandbox.go()
    before = (sandbox.run / name).read_bytes() if (sandbox.run / name).is_file() else b""
    sandbox.edit("first", outputs={name: {"bytes": 10**6, "sha256": DIGEST}})
    sandbox.go()
    assert (sandbox.run / name).exists()
    if before:
        assert (sandbox.run / name).read_bytes() == before or name == "stages/second.json"


@pytest.mark.parametrize("replace", [False, True])
@pytest.mark.parametrize("link", ["one", "one/a.txt", "one/deep", "two.txt"])
def test_a_link_in_the_place_of_an_output_is_refused(sandbox, link, replace):
    sandbox.go()
    path = sandbox.run / link
    if path.is_dir():
        (path / "a.txt").unlink()
        path.rmdir()
    path.unlink(missing_ok=True)
    path.symlink_to(sandbox.decoy / "a.txt" if link.endswith("txt") else sandbox.decoy)
    seed = 1 if replace else 0
    (sandbox.run / "stages" / "first.json").unlink()
    (sandbox.run / "stages" / "second.json").unlink()
    with pytest.raises(DataError, match="a link to"):
        sandbox.go(seed, replace=replace)
    assert sandbox.is_whole()
    assert path.is_symlink()


@pytest.mark.parametrize("name", [".lock", "stages", "config.yaml", "run.json"])
def test_a_link_in_the_place_of_the_runs_own_files_is_refused(sandbox, name):
    sandbox.go()
    path = sandbox.run / name
    if path.is_dir():
        path.rename(sandbox.run / "other")
        path.symlink_to(sandbox.decoy)
    else:
        path.unlink()
        path.symlink_to(sandbox.decoy / "a.txt")
    if name == "run.json":
        (sandbox.run / "stages" / "second.json").unlink()
    with pytest.raises(DataError):
        sandbox.go()
    assert sandbox.is_whole()


def test_a_finished_stage_whose_output_was_moved_to_another_disk_is_read_there(sandbox, tmp_path):
    """Nothing is removed or written then."""
    sandbox.go()
    (sandbox.run / "one").rename(tmp_path / "disk")
    (sandbox.run / "one").symlink_to(tmp_path / "disk")
    sandbox.go()
    assert (tmp_path / "disk" / "a.txt").read_text() == "0"


@pytest.mark.parametrize("kind", ["link", "dangling", "pipe"])
def test_a_file_takes_the_place_of_files_alone(tmp_path, kind):
    path, target = tmp_path / "out.json", tmp_path / "target"
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(target)
    if kind == "link":
        target.write_text("years of work")
    before = path.lstat()
    with pytest.raises(DataError, match="not replaced"):
        write_json(path, {})
    assert path.lstat() == before
    assert target.exists() == (kind == "link")
    assert sorted(tmp_path.iterdir()) == sorted({path, target} if kind == "link" else {path})


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=4), inner, max_size=2),
    max_leaves=4,
)


@given(
    key=st.sampled_from(
        [
            "stage",
            "status",
            "fingerprint",
            "config",
            "inputs",
            "outputs",
            "result",
            "seconds",
            "made_by",
            "more",
        ]
    ),
    value=values,
    missing=st.booleans(),
)
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_record_of_any_content_is_taken_or_refused_in_words(sandbox, key, value, missing):
    sandbox.go(replace=True)
    path = sandbox.run / "stages" / "first.json"
    whole = path.read_bytes()
    content = json.loads(whole)
    content[key] = value
    if missing:
        del content[key]
    path.write_text(json.dumps(content))
    said = refusal(sandbox)
    assert said is None or str(path) in said
    path.write_bytes(whole)
    assert sandbox.is_whole()


def refusal(sandbox):
    """The sentence with which the run is refused, if it is; any other exception is a failure."""
    try:
        sandbox.go(replace=True)
    except GeopriorError as error:
        return error.message
    return None
