"""Training logs as they are after crashes and resumes."""

import json

import numpy as np
import pytest

from geoprior.errors import DataError
from geoprior.report.losses import MAX_POINTS, read_log


def write(path, entries):
    path.write_text("".join(json.dumps(entry) + "\n" for entry in entries), encoding="utf-8")
    return path


def test_l1_over_epochs(tmp_path):
    entries = [{"step": n, "epoch": n / 2, "loss": 5.0, "l1": 1.0 / n, "kl": 0.1} for n in range(1, 11)]
    curve = read_log("pretrain", write(tmp_path / "log.jsonl", entries))
    assert (curve.metric, curve.x_name, curve.damaged) == ("l1", "epoch", 0)
    np.testing.assert_allclose(curve.values, [1.0 / n for n in range(1, 11)])
    np.testing.assert_allclose(curve.x, [n / 2 for n in range(1, 11)])


def test_without_l1_the_loss_and_without_epochs_the_steps(tmp_path):
    curve = read_log("a", write(tmp_path / "log.jsonl", [{"step": 5, "loss": 2.0}, {"step": 9, "loss": 1.0}]))
    assert (curve.metric, curve.x_name) == ("loss", "step")
    assert curve.x.tolist() == [5.0, 9.0]


def test_metrics_may_be_nested(tmp_path):
    curve = read_log("a", write(tmp_path / "log.jsonl", [{"step": 1, "epoch": 1, "metrics": {"l1": 0.5}}]))
    assert curve.values.tolist() == [0.5]


def test_steps_that_a_resume_repeats_count_once(tmp_path):
    steps = [1, 2, 3, 4, 3, 4, 5]
    entries = [{"step": s, "epoch": s, "l1": float(place)} for place, s in enumerate(steps)]
    curve = read_log("a", write(tmp_path / "log.jsonl", entries))
    assert curve.x.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert curve.values.tolist() == [0.0, 1.0, 4.0, 5.0, 6.0]


def test_a_cut_line_is_left_out_and_counted(tmp_path):
    path = write(tmp_path / "log.jsonl", [{"step": n, "epoch": n, "l1": 1.0} for n in (1, 2)])
    path.write_bytes(path.read_bytes() + b'{"step": 3, "ep')
    curve = read_log("a", path)
    assert (len(curve.x), curve.damaged) == (2, 1)


@pytest.mark.parametrize("content", [b"", b"{}\n[1]\n", b'{"step": 1}\n', b'{"step": 1, "l1": NaN}\n'])
def test_a_log_without_losses_is_none(tmp_path, content):
    path = tmp_path / "log.jsonl"
    path.write_bytes(content)
    assert read_log("a", path) is None


@pytest.mark.parametrize("length", [1, MAX_POINTS, MAX_POINTS + 1, 4321])
def test_thinning_keeps_the_mean_and_the_order(tmp_path, length):
    entries = [{"step": n, "epoch": n, "l1": float(n)} for n in range(1, length + 1)]
    curve = read_log("a", write(tmp_path / "log.jsonl", entries))
    assert len(curve.x) <= MAX_POINTS
    np.testing.assert_allclose(curve.x, curve.values)
    assert np.all(np.diff(curve.x) > 0)
    assert curve.values.mean() == pytest.approx((length + 1) / 2, rel=0.01)


def test_a_missing_log_is_named(tmp_path):
    with pytest.raises(DataError, match=r"gone\.jsonl"):
        read_log("a", tmp_path / "gone.jsonl")
