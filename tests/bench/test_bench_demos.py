from __future__ import annotations

import pytest

from benchmarks import demos
from benchmarks.demos import ROBOTS, TASKS, measure, measure_quickly
from geoprior.errors import MachineError


def test_one_demonstration_is_timed():
    (metric,) = measure_quickly()
    assert 1.0 < metric.value < 300.0
    assert metric.goal is None


def test_each_combination_has_its_goal(monkeypatch):
    monkeypatch.setattr(demos, "_collect", lambda robot, task, episodes: (29.0 + (task == "door") * 2.0, 21))
    metrics = [metric for metric in measure() if metric.goal is not None]
    assert len(metrics) == len(ROBOTS) * len(TASKS) == 15
    assert [metric.metric for metric in metrics if not metric.met] == [
        f"20 demonstrations of door on {robot}, both views 96x96" for robot in ROBOTS
    ]


def test_a_command_that_fails_is_no_measurement():
    with pytest.raises(MachineError, match="unknown robot 'nobody'"):
        demos._collect("nobody", "pick", 1)
