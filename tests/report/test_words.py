"""Numbers as words."""

import pytest

from geoprior.report import words
from geoprior.study.schema import Bounds

plain = {"\u202f": " ", "\u2212": "-"}


def ascii_of(text):
    return text.translate(str.maketrans(plain))


@pytest.mark.parametrize(
    ("rate", "text"), [(0.0, "0 %"), (1.0, "100 %"), (19 / 30, "63 %"), (0.125, "13 %"), (0.004, "0 %")]
)
def test_percent(rate, text):
    assert ascii_of(words.percent(rate)) == text


@pytest.mark.parametrize(
    ("difference", "text"), [(0.63, "+63"), (-0.63, "-63"), (0.004, "0"), (-0.004, "0"), (-1.0, "-100")]
)
def test_points_have_a_sign_unless_they_are_none(difference, text):
    assert ascii_of(words.points(difference)) == text


def test_intervals():
    assert ascii_of(words.percent_interval(Bounds(low=0.455, high=0.781))) == "46 to 78 %"
    assert ascii_of(words.points_interval(Bounds(low=-0.05, high=0.2))) == "-5 to +20"


@pytest.mark.parametrize(
    ("p", "text"), [(1.0, "1.00"), (0.123, "0.12"), (0.0213, "0.021"), (0.0004, "< 0.001"), (0.0, "< 0.001")]
)
def test_p_values_are_never_zero(p, text):
    assert ascii_of(words.p_value(p)) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.04, "0.0 s"), (9.1, "9.1 s"), (59.7, "1 min 0 s"), (131.0, "2 min 11 s"), (7260.0, "2 h 1 min")],
)
def test_durations(seconds, text):
    assert ascii_of(words.duration(seconds)) == text
