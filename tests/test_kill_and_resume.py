"""The whole line, killed with -9 in the middle of every stage, ends as an undisturbed run does."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from geoprior.stages import STAGE_NAMES


def rows(path):
    return len(path.read_text().splitlines()) if path.exists() else 0


MIDDLE = {
    "generate": lambda run: list(run.glob("shards/synthetic/*.tar")),
    "pretrain": lambda run: rows(run / "checkpoints/pretrain/log.jsonl") > 1,
    "demos": lambda run: list(run.glob("shards/demos/*")),
    "finetune": lambda run: list(run.glob("checkpoints/finetune/prior-s0/epoch-*.safetensors")),
    "evaluate": lambda run: rows(run / "rollouts.jsonl") > 4,
    "report": lambda run: status(run, "report") == "begun",
}


def status(run, stage):
    try:
        return json.loads((run / "stages" / f"{stage}.json").read_text())["status"]
    except (OSError, ValueError):
        return None


def start(config, run):
    """With one worker process where the undisturbed run has two: half as much to start, the same results."""
    command = [sys.executable, "-m", "geoprior", "run", str(config), "--out", str(run)]
    command += ["--set", "executor={name: local, workers: 1}"]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)


@pytest.fixture(autouse=True)
def heed_ctrl_c():
    """A shell's background job ignores SIGINT, and so would what it starts: these tests among them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def finish(config, run):
    process = start(config, run)
    _, said = process.communicate(timeout=600)
    assert process.returncode == 0, said
    return said


def kill_in_the_middle(config, run, stage):
    """Kill the parent alone, as the out-of-memory killer would; its workers must end by themselves."""
    process = start(config, run)
    deadline = time.monotonic() + 300
    while not MIDDLE[stage](run) and process.poll() is None:
        assert time.monotonic() < deadline, f"{stage} never came to its middle"
        time.sleep(0.002)
    caught = process.poll() is None and status(run, stage) == "begun"
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=60)
    wait_until_alone(process.pid)
    return caught


def wait_until_alone(group):
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.1)
    pytest.fail("workers outlive their killed parent")


def test_killed_in_every_stage_it_goes_on_to_the_same_results(tiny_config, tiny_run, tmp_path):
    run = tmp_path / "run"
    caught = {stage: kill_in_the_middle(tiny_config, run, stage) for stage in STAGE_NAMES}
    said = finish(tiny_config, run)
    assert all(caught[stage] for stage in STAGE_NAMES if stage != "report"), caught
    assert "generate: done before, skipped" in said
    assert (run / "results.json").read_bytes() == (tiny_run / "results.json").read_bytes()
    for name in ("rollouts.jsonl", "shards/synthetic/manifest.json", "shards/demos/manifest.json"):
        assert (run / name).read_bytes() == (tiny_run / name).read_bytes()
    for path in (tiny_run / "checkpoints").rglob("epoch-*.safetensors"):
        assert (run / path.relative_to(tiny_run)).read_bytes() == path.read_bytes(), path.name


def test_a_second_run_skips_everything(tiny_config, tiny_run):
    before = {path: path.stat().st_mtime_ns for path in tiny_run.glob("checkpoints/**/*.safetensors")}
    said = finish(tiny_config, tiny_run)
    assert all(f"{stage}: done before, skipped" in said for stage in STAGE_NAMES)
    assert before == {path: path.stat().st_mtime_ns for path in before}


def test_the_run_folder_holds_what_it_promises(tiny_run):
    for name in ("config.yaml", "run.json", "results.json", "rollouts.jsonl", "report/index.html"):
        assert (tiny_run / name).stat().st_size > 0
    lines = [json.loads(line) for line in (tiny_run / "rollouts.jsonl").read_text().splitlines()]
    assert len(lines) == 2 * 2 * 3, "conditions x checkpoints x trials"
    states = {(line["condition"], line["epoch"]): set() for line in lines}
    for line in lines:
        states[line["condition"], line["epoch"]].add(line["state_seed"])
    assert len({frozenset(seeds) for seeds in states.values()}) == 1, "conditions are paired"


def test_ctrl_c_says_how_to_go_on_and_ends_with_130(tiny_config, tmp_path):
    run = tmp_path / "run"
    process = start(tiny_config, run)
    while not MIDDLE["generate"](run):
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "same command goes on" in said
    assert "Traceback" not in said
