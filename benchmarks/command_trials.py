"""Trials whose commands come from no policy: no pictures, many initial states, resumable.

Shared by experts.py and open_loop_replay.py. Every trial is a line of a work file when it ends; the same
command goes on from there. The file's name holds a digest of the simulation's sources, so that a changed
task, expert or controller begins a new one.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import geoprior.sim
from benchmarks.demos import ROBOTS, TASKS
from benchmarks.metrics import Metric, as_lines, report
from geoprior.executors.local import LocalConfig, LocalExecutor
from geoprior.files import sha256_file, sha256_json, write_json
from geoprior.geometry.camera import CamerasConfig
from geoprior.hooks.manager import plugins
from geoprior.options import Choice
from geoprior.progress import track
from geoprior.sim.judge import GAVE_UP, UNSTABLE, Judge
from geoprior.sim.records import TrialRecord, append_record, read_records
from geoprior.sim.workers import Setup, environment

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geoprior.sim.environment import Environment

CONTROL_RATE = 10
PAPER = {"robot": ROBOTS, "task": TASKS}
"""Section IV-A of the paper."""


@dataclass(frozen=True)
class Unit:
    """One trial to run.

    Attributes:
        robot: Registered name.
        task: Registered name.
        condition: Where the commands come from, or what carries them out.
        state: Seed of the initial state.
    """

    robot: str
    task: str
    condition: str
    state: int


def make(robot: str, task: str, controller: str = "fast") -> Environment:
    """This process's environment; nothing is drawn, so the cameras do not matter."""
    arm = Choice(name=robot, options={"controller": controller})
    return environment(Setup(arm, Choice(name=task), CamerasConfig()), CONTROL_RATE)


def watch(
    env: Environment, commands: Iterable[NDArray[np.float32]], *, to_the_end: bool
) -> tuple[str, list[NDArray[np.float32]]]:
    """Carry commands out on an environment that has just been reset.

    Args:
        env: Reset.
        commands: (8,) each.
        to_the_end: Whether success must stand after the last command; else it counts once it is reached.

    Returns:
        The reason of failure, empty on success, and the commands that were carried out.
    """
    from geoprior.sim.environment import UnstablePhysicsError

    judge, verdict, done = Judge(env), None, []
    for command in commands:
        done.append(command)
        try:
            env.step(command)
        except UnstablePhysicsError:
            return UNSTABLE, done
        verdict = judge.look()
        if verdict or (verdict == "" and not to_the_end):
            break
    return (GAVE_UP if verdict is None else verdict), done


def record(unit: Unit, reason: str, steps: int) -> TrialRecord:
    """A trial as the work file keeps it."""
    return TrialRecord(
        robot=unit.robot,
        task=unit.task,
        condition=unit.condition,
        training_seed=0,
        epoch=0,
        state_seed=unit.state,
        success=not reason,
        reason=reason,
        steps=steps,
        seconds=steps / CONTROL_RATE,
    )


def run_all(
    name: str, units: Sequence[Unit], run: Callable[[Unit], TrialRecord], options: argparse.Namespace
) -> dict[tuple[str, str], list[TrialRecord]]:
    """Run what the work file lacks.

    Returns:
        The trials of each robot and task, in the order of the units.
    """
    path = options.work / f"{name}-{_sources_digest()[:12]}.jsonl"
    records = {_unit_of(each): each for each in read_records(path)}
    missing = [unit for unit in units if unit not in records]
    with track(name, len(units), "trials", done=len(units) - len(missing)) as progress:
        for _, result in LocalExecutor(LocalConfig(workers=options.workers)).run(run, missing):
            append_record(path, result)
            records[_unit_of(result)] = result
            progress.advance(robot=result.robot, task=result.task)
    combinations: dict[tuple[str, str], list[TrialRecord]] = {}
    for unit in units:
        combinations.setdefault((unit.robot, unit.task), []).append(records[unit])
    return combinations


def parse(description: str | None) -> argparse.ArgumentParser:
    """The options that both benchmarks have."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for kind, names in PAPER.items():
        choices, text = plugins().names(kind), f"the paper's by default: {', '.join(names)}"
        parser.add_argument(f"--{kind}s", nargs="+", choices=choices, default=names, help=text)
    parser.add_argument("--workers", type=int, default=1, help="processes; 0 takes one for each core")
    parser.add_argument("--work", type=Path, default=Path("runs"), help="folder of the work file")
    parser.add_argument("--json", type=Path, help="where the result goes, besides the terminal")
    return parser


def pairs(options: argparse.Namespace) -> list[tuple[str, str]]:
    """Every robot with every task that is wanted."""
    return [(robot, task) for robot in options.robots for task in options.tasks]


def tell(
    name: str,
    metrics: Sequence[Metric],
    combinations: dict[tuple[str, str], list[TrialRecord]],
    json_path: Path | None,
) -> None:
    """Print the result and write it; reasons of failure are counted beside the metrics."""
    content = report(name, " ".join(["python", *sys.argv]), metrics)
    content["reasons"] = {
        f"{task} on {robot}": dict(Counter(each.reason or "success" for each in trials))
        for (robot, task), trials in combinations.items()
    }
    print("\n".join(as_lines(content)))
    print(json.dumps(content["reasons"], indent=2))
    if json_path is not None:
        write_json(json_path, content)


def _unit_of(trial: TrialRecord) -> Unit:
    return Unit(trial.robot, trial.task, trial.condition, trial.state_seed)


def _sources_digest() -> str:
    folder = Path(next(iter(geoprior.sim.__path__)))
    return sha256_json({str(path.relative_to(folder)): sha256_file(path) for path in folder.rglob("*.py")})
