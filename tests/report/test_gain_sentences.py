"""What the page says of the prior's gain: true to the numbers, and silent where they are."""

import pytest
from report_material import results, trials

from geoprior.report.controls import sentences, share_percent, share_percent_interval
from geoprior.report.report import write_report
from geoprior.study.results import summarise
from geoprior.study.schema import Bounds

CONTROLS = {"blind": "blind", "numbers": "statistics"}


def flat(rate):
    return {256: rate, 512: rate}


RATES = {"scratch": flat(0.05), "prior": flat(0.85), "numbers": flat(0.2), "blind": flat(0.4)}


def group_of(rates, **options):
    return summarise(trials(rates, **options), seed=0, controls=CONTROLS).groups[0]


def page(rates, folder):
    found = summarise(trials(rates), seed=0, controls=CONTROLS).model_dump(mode="json")
    path = write_report(out=folder, results=found, config_text="seed: 0\n", run={})
    return path.read_text(encoding="utf-8")


def test_a_sentence_for_each_part_of_the_gain():
    group = group_of(RATES, training_seeds=(0, 1, 2, 3, 4))
    said = sentences(group)
    shares = {share.condition: share for share in group.gain_shares}
    assert said[0].startswith("The prior gains +")
    (blind,) = [sentence for sentence in said if sentence.startswith("blind, ")]
    (numbers,) = [sentence for sentence in said if sentence.startswith("numbers, ")]
    (rest,) = [sentence for sentence in said if "owes to the images" in sentence]
    assert "black images" in blind
    assert "normalisation" in numbers
    assert f"has {share_percent(shares['blind'].share)} of it" in blind
    assert f"has {share_percent(shares['numbers'].share)} of it" in numbers
    assert share_percent(1.0 - shares["blind"].share) in rest
    high = shares["blind"].interval.high
    assert f"({share_percent(1.0 - high)} to" in rest


def test_of_a_gain_that_is_not_clear_nothing_is_said_but_that():
    group = group_of({**RATES, "prior": flat(0.06)})
    (said,) = sentences(group)
    assert "not clearly above zero" in said


def test_without_controls_nothing_is_said(tmp_path):
    rates = {name: RATES[name] for name in ("scratch", "prior")}
    assert sentences(group_of(rates)) == []
    assert "What the gain is made of" not in page(rates, tmp_path)


def test_the_page_has_the_table(tmp_path):
    text = page(RATES, tmp_path)
    assert "What the gain is made of" in text
    assert "share of prior\u2019s gain" in text
    for share in group_of(RATES).gain_shares:
        assert share_percent(share.share) in text
    assert "the gain is not clear" in page({**RATES, "prior": flat(0.06)}, tmp_path)


@pytest.mark.parametrize(
    ("share", "text"), [(0.4, "40 %"), (-0.05, "\u22125 %"), (1.32, "132 %"), (-0.001, "0 %"), (0.0, "0 %")]
)
def test_shares_may_be_below_zero_and_above_one(share, text):
    assert share_percent(share).replace("\u202f", " ") == text


def test_an_interval_of_shares():
    text = share_percent_interval(Bounds(low=-0.2, high=0.35)).replace("\u202f", " ")
    assert text == "\u221220 % to 35 %"


def test_results_without_the_table_are_still_a_page(tmp_path):
    old = results()
    for group in old["groups"]:
        del group["gain_shares"]
    assert write_report(out=tmp_path, results=old, config_text="", run={}).is_file()
