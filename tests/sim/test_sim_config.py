from __future__ import annotations

import pytest
from pydantic import ValidationError

from geoprior.sim.config import DemosConfig, EvaluateConfig


def test_states_and_attempts_are_plain_ranges():
    assert EvaluateConfig(trials=3, first_state=7).states == range(7, 10)
    assert DemosConfig(episodes=4, attempts_per_episode=5).max_attempts == 20


@pytest.mark.parametrize("rate", [3, 30, 60, 499])
def test_control_rate_must_divide_the_physics(rate):
    with pytest.raises(ValidationError, match="must divide 500"):
        DemosConfig(control_rate=rate)


@pytest.mark.parametrize(
    "fault", [{"trials": 0}, {"ensembling": float("nan")}, {"film_size": 63}, {"first_state": -1}]
)
def test_values_out_of_range_are_refused(fault):
    with pytest.raises(ValidationError):
        EvaluateConfig(**fault)
