"""Whether a task needs eyes: one demonstration's commands, carried out blindly from other initial states.

    python -m benchmarks open_loop_replay --json benchmarks/results/open_loop_replay.json

For every robot and task some successful demonstrations are replayed from the same unseen initial states. The
last command is held for a second more, and success counts once it is reached.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import chain, count, islice, repeat
from typing import TYPE_CHECKING

from benchmarks.command_trials import CONTROL_RATE, Unit, make, pairs, parse, record, run_all, tell, watch
from benchmarks.metrics import at_most
from geoprior.sim.records import TrialRecord

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

GOAL = 0.15
SEED = 0
"""Root seed of the experts' variation."""
APART = 100
"""Demonstration k is the first success from initial state k x this on."""


@lru_cache(maxsize=4)
def demonstration(robot: str, task: str, number: int) -> list[NDArray[np.float32]]:
    """Commands of a successful demonstration."""
    env = make(robot, task)
    for state in islice(count(APART * number), APART):
        env.reset(state)
        reason, commands = watch(env, env.expert(SEED), to_the_end=True)
        if not reason:
            return commands
    raise SystemExit(f"{task} on {robot}: no success from {APART} initial states; run benchmarks/experts.py")


def replay(unit: Unit) -> TrialRecord:
    """One replay; the unit's condition ends with the demonstration's number."""
    commands = demonstration(unit.robot, unit.task, int(unit.condition.rpartition(" ")[2]))
    env = make(unit.robot, unit.task)
    env.reset(unit.state)
    reason, done = watch(env, chain(commands, repeat(commands[-1], CONTROL_RATE)), to_the_end=False)
    return record(unit, reason, len(done))


def main() -> None:
    """Run, print, and write the JSON."""
    parser = parse(__doc__)
    parser.add_argument("--demonstrations", type=int, default=3, help="for each robot and task")
    parser.add_argument("--states", type=int, default=20, help="initial states for each demonstration")
    parser.add_argument("--first-state", type=int, default=1_000_000)
    options = parser.parse_args()
    states = range(options.first_state, options.first_state + options.states)
    units = [
        Unit(robot, task, f"replay of demonstration {number}", state)
        for robot, task in pairs(options)
        for number in range(options.demonstrations)
        for state in states
    ]
    combinations = run_all("open-loop-replay", units, replay, options)
    metrics = [
        at_most(
            f"{task} on {robot}: success, {len(found)} replays",
            sum(each.success for each in found) / len(found),
            "share",
            GOAL,
        )
        for (robot, task), found in combinations.items()
    ]
    tell("open-loop replay", metrics, combinations, options.json)


if __name__ == "__main__":
    main()
