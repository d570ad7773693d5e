"""How often the scripted experts succeed, and how long they take, on every robot and task.

    python -m benchmarks experts --json benchmarks/results/experts.json

One attempt on each initial state from ``--first-state`` on, without pictures, with each controller; nothing
is tried again, and an attempt counts only if the task's goal still holds after the expert's last command. The
states are none of those on which the experts were written.
"""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.command_trials import Unit, make, pairs, parse, record, run_all, tell, watch
from benchmarks.metrics import Metric, at_least
from geoprior.sim.control import LAWS
from geoprior.sim.records import TrialRecord

GOAL = 0.95
SEED = 0
"""Root seed of the experts' variation."""


def attempt(unit: Unit) -> TrialRecord:
    """One demonstration from the unit's initial state."""
    env = make(unit.robot, unit.task, unit.condition)
    env.reset(unit.state)
    reason, commands = watch(env, env.expert(SEED), to_the_end=True)
    return record(unit, reason, len(commands))


def metrics_of(robot: str, task: str, trials: list[TrialRecord]) -> Iterator[Metric]:
    """Success with each controller and length of one combination."""
    name = f"{task} on {robot}"
    controllers = sorted({each.condition for each in trials}, reverse=True)
    for controller in controllers:
        mine = [each for each in trials if each.condition == controller]
        share = sum(each.success for each in mine) / len(mine)
        yield at_least(f"{name}, {controller}: success, {len(mine)} states", share, "share", GOAL)
    if len(controllers) > 1:
        won = [
            {each.state_seed for each in trials if each.success and each.condition == c} for c in controllers
        ]
        yield Metric(f"{name}: states won with one controller only", len(won[0] ^ won[1]), "states")
    lengths = [each.seconds for each in trials if each.success]
    if lengths:
        yield Metric(f"{name}: mean length of a success", sum(lengths) / len(lengths), "s")
        yield Metric(f"{name}: longest success", max(lengths), "s")


def main() -> None:
    """Run, print, and write the JSON."""
    parser = parse(__doc__)
    parser.add_argument("--states", type=int, default=100, help="initial states for each robot and task")
    parser.add_argument("--first-state", type=int, default=4_000_000)
    parser.add_argument("--controllers", nargs="+", choices=LAWS, default=["fast", "exact"])
    options = parser.parse_args()
    states = range(options.first_state, options.first_state + options.states)
    units = [
        Unit(robot, task, controller, state)
        for robot, task in pairs(options)
        for controller in options.controllers
        for state in states
    ]
    combinations = run_all("experts", units, attempt, options)
    metrics = [row for (robot, task), found in combinations.items() for row in metrics_of(robot, task, found)]
    tell("experts", metrics, combinations, options.json)


if __name__ == "__main__":
    main()
