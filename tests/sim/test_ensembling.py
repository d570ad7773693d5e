from __future__ import annotations

import numpy as np
import pytest

from geoprior.sim.ensembling import OpenLoop, TemporalEnsemble, blend


def _pose(x: float, gripper: float = 0.0, quaternion=(0.0, 0.0, 0.0, 1.0)) -> np.ndarray:
    return np.array([x, 0.0, 0.0, *quaternion, gripper], dtype=np.float32)


def test_weights_are_those_of_act():
    predictions = np.stack([_pose(1.0), _pose(2.0), _pose(4.0)])
    weights = np.exp(-0.5 * np.arange(3))
    expected = (weights @ [1.0, 2.0, 4.0]) / weights.sum()
    assert blend(predictions, 0.5)[0] == pytest.approx(expected, rel=1e-6)
    assert blend(predictions, 50.0)[0] == pytest.approx(1.0)


def test_quaternion_signs_do_not_matter():
    angle = 0.2
    turned = (0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2))
    plain = blend(np.stack([_pose(0.0), _pose(0.0, quaternion=turned)]), 0.0)
    flipped = blend(np.stack([_pose(0.0), _pose(0.0, quaternion=tuple(-q for q in turned))]), 0.0)
    np.testing.assert_allclose(flipped, plain, atol=1e-7)
    half = [0.0, 0.0, np.sin(angle / 4), np.cos(angle / 4)]
    np.testing.assert_allclose(plain[3:7], half, atol=1e-6)


@pytest.mark.parametrize(("votes", "expected"), [((1, 1, 0), 1.0), ((1, 0, 0), 0.0), ((1, 0), 1.0)])
def test_gripper_goes_with_the_majority_and_stays_a_step(votes, expected):
    assert blend(np.stack([_pose(0.0, gripper=vote) for vote in votes]), 0.0)[7] == expected


def test_ensemble_uses_every_prediction_of_the_present_step_and_no_other():
    ensemble = TemporalEnsemble(0.0)
    for step in range(5):
        assert ensemble.wants_chunk(step)
        # Row k of a chunk of 3 predicts step + k, and says so, plus who said it.
        ensemble.add(step, np.stack([_pose(100.0 * (step + k) + step) for k in range(3)]))
        said_by = range(max(0, step - 2), step + 1)
        expected = np.mean([100.0 * step + begun for begun in said_by])
        assert ensemble.command(step)[0] == pytest.approx(expected)


@pytest.mark.parametrize(("execute", "looks"), [(2, [0, 2, 4, 6]), (3, [0, 3, 6]), (9, [0, 4])])
def test_open_loop_looks_when_its_share_is_used_up(execute, looks):
    strategy = OpenLoop(execute)
    looked = []
    for step in range(8):
        if strategy.wants_chunk(step):
            looked.append(step)
            strategy.add(step, np.stack([_pose(step + k) for k in range(4)]))
        assert strategy.command(step)[0] == step
    assert looked == looks
