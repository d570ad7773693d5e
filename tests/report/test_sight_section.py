import json

import pytest
from report_material import results

from geoprior.probe.sight import Sight, as_metrics
from geoprior.report.figures import NARROW, WIDE, sight_curves
from geoprior.report.report import write_report
from geoprior.report.sight import read_sight


def sight(true, shuffled, error=0.01):
    return Sight(true, shuffled, None, 0.3, 0.28, shuffled - true, error)


def write_log(path, checkpoints):
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w") as file:
        for step in range(1, 1 + 10 * len(checkpoints)):
            line = {"step": step, "epoch": step / 2, "l1": 1.0 / step}
            if step % 10 == 0:
                measured = checkpoints[step // 10 - 1]
                line |= as_metrics({"all": measured, "pick": measured})
            file.write(json.dumps(line) + "\n")
    return path


def page(tmp_path, losses):
    path = write_report(out=tmp_path / "report", results=results(), config_text="", run={}, losses=losses)
    return path.read_text(), tmp_path / "report" / "media"


def test_a_prior_that_sees_is_said_to_look_with_its_numbers(tmp_path):
    log = write_log(tmp_path / "log.jsonl", [sight(0.29, 0.3), sight(0.2123, 0.4321)])
    html, media = page(tmp_path, {"pretrain": log})
    assert "Does the prior see?" in html
    assert "The prior looks" in html
    assert "0.212" in html
    assert "0.432" in html
    assert "may be blind" not in html
    figure = (media / "sight.svg").read_text()
    for label in ("true images", "standing still", "pose alone", "epochs of pretraining"):
        assert label in figure


def test_a_blind_prior_is_cautioned_of_with_the_remedy(tmp_path):
    log = write_log(tmp_path / "log.jsonl", [sight(0.31, 0.31)])
    html, _ = page(tmp_path, {"pretrain": log})
    assert "The prior may be blind" in html
    assert "pretrain.epochs" in html


@pytest.mark.parametrize("losses", [None, {}, "plain"])
def test_where_it_was_not_measured_the_page_says_nothing_of_it(tmp_path, losses):
    if losses == "plain":
        path = tmp_path / "log.jsonl"
        path.write_text(json.dumps({"step": 1, "epoch": 1.0, "l1": 0.5}) + "\n")
        losses = {"pretrain": path}
    html, media = page(tmp_path, losses)
    assert "Does the prior see" not in html
    assert not (media / "sight.svg").exists()


def test_the_log_is_read_in_order_and_damaged_lines_are_left_out(tmp_path):
    log = write_log(tmp_path / "log.jsonl", [sight(0.3, 0.3), sight(0.2, 0.4)])
    log.write_text(log.read_text() + '{"step": 30, "true_l1": 0.1')
    curve = read_sight(log)
    assert curve.epochs == [5.0, 10.0]
    assert curve.lines["true images"] == [0.3, 0.2]
    assert curve.last["pick"].shuffled == 0.4


@pytest.mark.parametrize("size", [WIDE, NARROW])
@pytest.mark.parametrize("count", [1, 5])
def test_the_same_numbers_give_the_same_bytes(size, count):
    lines = {
        name: [0.3] * count for name in ("true images", "another's images", "standing still", "pose alone")
    }
    epochs = list(range(1, 1 + count))
    assert sight_curves(epochs, lines, size) == sight_curves(epochs, lines, size)
