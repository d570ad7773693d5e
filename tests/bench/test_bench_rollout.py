from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

from benchmarks import rollout
from benchmarks.rollout import DRIVES, measure_quickly
from benchmarks.stepping import SIZE, Drive, Slice, measure_costs, step_ours


def test_every_nth_step_is_looked_at(monkeypatch):
    from geoprior.sim.environment import Environment

    looks, steps, step, reset = [], [], Environment.step, Environment.reset
    episodes = []
    monkeypatch.setattr(Environment, "observe", lambda env: looks.append(env.cameras.height))
    monkeypatch.setattr(Environment, "step", lambda env, command: (steps.append(0), step(env, command)))
    monkeypatch.setattr(
        Environment, "reset", lambda env, state: (episodes.append(len(steps)), reset(env, state))
    )
    slice_ = step_ours(Drive("fast", 8), seconds=0.2)
    assert slice_.steps == len(steps)
    assert slice_.seconds > 0.2
    assert set(looks) == {SIZE}
    lengths = np.diff([*episodes, len(steps)])
    assert len(looks) == sum(-(-length // 8) for length in lengths), "each episode begins with a look"


def test_the_parts_of_a_step_add_up_to_it():
    costs = measure_costs("exact")
    assert min(costs.physics, costs.controller, costs.frames) > 0.0
    assert costs.controller > 0.2 * costs.physics, "the exact controller costs more than physics"
    assert 0.0 < costs.rest + costs.controller + costs.physics < 1000.0


def test_slices_of_both_sides_alternate_and_their_ratio_is_told(monkeypatch):
    order = []

    class Here(ProcessPoolExecutor):
        def __init__(self) -> None:
            pass

        def __exit__(self, *_: object) -> None:
            pass

        def submit(self, function, *arguments):
            order.append(function)
            return Done(function(*arguments))

    class Done:
        def __init__(self, value) -> None:
            self.result = lambda: value

    monkeypatch.setattr(rollout, "_process", Here)
    monkeypatch.setattr(rollout, "step_stock", stock := lambda seconds: Slice(5, 1.0))
    monkeypatch.setattr(
        rollout, "step_ours", ours := lambda drive, seconds: Slice(60 // drive.look_every, 1.0)
    )
    monkeypatch.setattr(rollout, "measure_costs", lambda controller: measure_nothing())
    metrics = {metric.metric: metric for metric in measure_quickly()}
    a_round = [stock, *[ours] * rollout.PROCESSES * len(DRIVES)]
    assert order[: 3 * len(a_round)] == 3 * a_round
    assert metrics["fast, frames at every step, 2 processes"].value == 120.0
    assert metrics["fast, frames at every step: over robosuite"].value == 24.0
    assert metrics["exact, frames at every 8th step: over robosuite"].value == 14.0 / 5.0 * 1.0
    assert all(metric.goal is None for metric in metrics.values())


def measure_nothing():
    from benchmarks.stepping import Costs

    return Costs(1.0, 1.0, 1.0, 1.0)


@pytest.mark.slow
def test_it_runs_for_real():
    metrics = {metric.metric: metric.value for metric in measure_quickly()}
    assert metrics["fast, frames at every step: over robosuite"] > 1.0
    assert (
        metrics["fast: controller of a step with both frames"]
        < metrics["exact: controller of a step with both frames"]
    )
