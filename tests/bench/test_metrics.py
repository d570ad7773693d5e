from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.catalogue import BENCHMARKS, STUDIES, run
from benchmarks.memory import PeakMemory, memory_bytes
from benchmarks.metrics import Metric, as_lines, at_least, at_most, report
from geoprior.errors import ConfigError

ROOT = Path(__file__).parents[2]


def test_a_goal_is_met_on_its_own_side():
    assert [at_most("m", value, "s", 2.0).met for value in (1.0, 2.0, 3.0)] == [True, True, False]
    assert [at_least("m", value, "s", 2.0).met for value in (1.0, 2.0, 3.0)] == [False, True, True]


def test_the_object_is_json_with_machine_versions_and_results():
    content = json.loads(json.dumps(report("x", "python -m benchmarks x", [at_most("time", 3.0, "s", 2.0)])))
    assert set(content) == {"name", "command", "machine", "versions", "results"}
    assert content["results"] == [{"metric": "time", "value": 3.0, "unit": "s", "goal": 2.0, "met": False}]
    assert any("MISSED" in line for line in as_lines(content))


def test_a_number_without_a_goal_says_nothing_of_one():
    lines = as_lines(report("x", "x", [Metric("time", 3.0, "s")]))
    assert "goal" not in lines[-1]


def test_memory_of_children_counts_and_the_peak_stays():
    size = 60 << 20
    before = memory_bytes(os.getpid())
    with PeakMemory(interval=0.01) as memory:
        code = f"import sys; held = bytearray({size}); print('x', flush=True); sys.stdin.read()"
        with subprocess.Popen(
            [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        ) as child:
            assert child.stdout.read(1) == b"x"
            with_child = memory_bytes(os.getpid())
            time.sleep(0.2)
            child.stdin.close()
    assert with_child > before + 0.9 * size
    assert memory.peak > before + 0.9 * size
    assert memory_bytes(os.getpid()) < before + 0.5 * size


def test_an_unknown_benchmark_shows_the_choices():
    with pytest.raises(ConfigError, match="genrate") as caught:
        run("genrate", quick=True, say=lambda _: None)
    assert "generate" in caught.value.hint


def test_every_benchmark_can_be_run_both_ways():

    for benchmark in BENCHMARKS.values():
        module = importlib.import_module(benchmark.module)
        assert callable(module.measure)
        assert callable(module.measure_quickly)


def test_every_study_reads_the_command_line():
    for name in STUDIES:
        assert callable(importlib.import_module(f"benchmarks.{name}").main)


@pytest.mark.parametrize("name", ["generate", "prior"])
def test_the_command_says_how_each_is_used(name):
    command = [sys.executable, "-m", "benchmarks", name, "--help"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert f"python -m benchmarks {name}" in done.stdout


def test_an_unknown_name_is_refused_with_the_way_to_the_list():
    command = [sys.executable, "-m", "benchmarks", "genrate"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "genrate" in done.stderr
    assert "--help" in done.stderr
