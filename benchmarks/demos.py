"""How long 20 demonstrations take, for each of the paper's arms and tasks.

The command is run as a user runs it: the time is that of the whole process, from its imports to the manifest.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.metrics import Metric, at_most
from geoprior.errors import MachineError
from geoprior.files import read_json
from geoprior.sim.demos import ATTEMPTS
from geoprior.stages import DEMOS

ROBOTS = ("ur5e", "xarm7", "kinova3")
TASKS = ("pick", "place", "push", "pile", "door")
EPISODES, SIZE, FIRST_STATE = 20, 96, 20_000
GOAL = 30.0


def measure() -> Iterator[Metric]:
    """20 demonstrations of each of the 15 combinations (some 5 minutes)."""
    for robot in ROBOTS:
        for task in TASKS:
            seconds, attempts = _collect(robot, task, EPISODES)
            name = f"{EPISODES} demonstrations of {task} on {robot}"
            yield at_most(f"{name}, both views {SIZE}x{SIZE}", seconds, "s", GOAL)
            yield Metric(f"{name}: attempts", attempts, "attempts")


def measure_quickly() -> Iterator[Metric]:
    """One demonstration of one combination."""
    seconds, _ = _collect(ROBOTS[0], TASKS[0], 1)
    yield Metric(f"1 demonstration of {TASKS[0]} on {ROBOTS[0]}", seconds, "s")


def _collect(robot: str, task: str, episodes: int) -> tuple[float, int]:
    """Seconds that the command took, and how many attempts it made."""
    settings = (
        f"robot={robot}",
        f"task={task}",
        f"cameras={{height: {SIZE}, width: {SIZE}}}",
        f"demos.episodes={episodes}",
        f"demos.first_state={FIRST_STATE}",
    )
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        _run(["demos", "quickstart", "--out", folder, *_overrides(settings)])
        return time.perf_counter() - began, len(read_json(Path(folder) / DEMOS / ATTEMPTS))


def _overrides(settings: Sequence[str]) -> list[str]:
    return [word for setting in settings for word in ("--set", setting)]


def _run(arguments: Sequence[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "geoprior", *arguments], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise MachineError(f"geoprior {' '.join(arguments)} failed: {done.stderr.strip()[-500:]}")
