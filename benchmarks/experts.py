"""How often the scripted experts succeed, and how long they take, on every robot and task.

    python benchmarks/experts.py --json benchmarks/results/experts.json

One attempt on each initial state from ``--first-state`` on, without pictures; nothing is tried again, and an
attempt counts only if the task's goal still holds after the expert's last command.
"""

from __future__ import annotations

from command_trials import Unit, make, pairs, parse, record, run_all, tell, watch

from geoprior.bench.metrics import Metric, at_least
from geoprior.sim.records import TrialRecord

GOAL = 0.95
SEED = 0
"""Root seed of the experts' variation."""


def attempt(unit: Unit) -> TrialRecord:
    """One demonstration from the unit's initial state."""
    env = make(unit.robot, unit.task)
    env.reset(unit.state)
    reason, commands = watch(env, env.expert(SEED), to_the_end=True)
    return record(unit, reason, len(commands))


def metrics_of(robot: str, task: str, trials: list[TrialRecord]) -> list[Metric]:
    """Success and length of one combination."""
    won = [each.seconds for each in trials if each.success]
    rows = [
        at_least(f"{task} on {robot}: success, {len(trials)} states", len(won) / len(trials), "share", GOAL)
    ]
    if won:
        rows.append(Metric(f"{task} on {robot}: mean length of a success", sum(won) / len(won), "s"))
        rows.append(Metric(f"{task} on {robot}: longest success", max(won), "s"))
    return rows


def main() -> None:
    """Run, print, and write the JSON."""
    parser = parse(__doc__)
    parser.add_argument("--states", type=int, default=100, help="initial states for each robot and task")
    parser.add_argument("--first-state", type=int, default=0)
    options = parser.parse_args()
    states = range(options.first_state, options.first_state + options.states)
    units = [Unit(robot, task, "expert", state) for robot, task in pairs(options) for state in states]
    combinations = run_all("experts", units, attempt, options)
    metrics = [row for (robot, task), found in combinations.items() for row in metrics_of(robot, task, found)]
    tell("experts", metrics, combinations, options.json)


if __name__ == "__main__":
    main()
