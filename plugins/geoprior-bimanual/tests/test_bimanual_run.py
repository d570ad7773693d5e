"""The example, cut down to see that every stage takes two hands, by the command that a user types."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from geoprior.policies.checkpoint import list_checkpoints, load_predictor

EXAMPLE = Path(__file__).parents[1] / "example.yaml"
SMALL = (
    "generate.episodes=2",
    "generate.seconds=4",
    "pretrain.epochs=1",
    "policy.dim=32",
    "policy.ffn=64",
    "policy.trunk_width=8",
    "demos.episodes=1",
    "finetune.epochs=1",
    "finetune.checkpoint_every=1",
    "evaluate.trials=1",
    "evaluate.time_limit=0.5",
    "executor=serial",
)


@pytest.mark.slow
def test_the_example_runs_from_scenes_to_a_report(tmp_path: Path) -> None:
    options = [word for each in SMALL for word in ("--set", each)]
    command = ["-m", "geoprior", "run", str(EXAMPLE), "--out", str(tmp_path / "run"), *options]
    done = subprocess.run([sys.executable, *command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    trials = [json.loads(line) for line in (tmp_path / "run/rollouts.jsonl").read_text().splitlines()]
    assert {trial["condition"] for trial in trials} == {"prior", "scratch"}
    assert {trial["task"] for trial in trials} == {"lift-pot"}
    assert (tmp_path / "run/report/index.html").is_file()
    for folder in ("pretrain", "finetune/prior-s0"):
        predictor = load_predictor(list_checkpoints(tmp_path / "run/checkpoints" / folder)[-1].path)
        assert predictor.features.pose_size == 16
        assert predictor.features.cameras == ("left", "right", "third")
