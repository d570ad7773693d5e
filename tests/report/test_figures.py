"""Figures: the numbers where they belong, the same bytes each time, nothing from outside."""

import re
import xml.etree.ElementTree as ET
from itertools import pairwise

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_material import trials

from geoprior.report.figures import NARROW, WIDE, learning_curves, loss_curves, spread
from geoprior.report.losses import LossCurve
from geoprior.report.palette import COLOURS, colours_of
from geoprior.study.results import summarise

RATES = {"prior": {256: 1.0, 512: 1.0}, "scratch": {256: 0.0, 512: 0.5}}


def group_of(rates=RATES, **kwargs):
    return summarise(trials(rates, **kwargs), seed=0).groups[0]


def loss_curve(name, values):
    values = np.asarray(values, dtype=float)
    return LossCurve(name, "l1", "epoch", np.arange(1.0, len(values) + 1), values, damaged=0)


def texts_of(svg):
    return [element.text for element in ET.fromstring(svg).iter("{http://www.w3.org/2000/svg}text")]


@pytest.mark.parametrize("size", [WIDE, NARROW])
def test_the_lines_carry_their_names_and_the_axes_their_units(size):
    texts = texts_of(learning_curves(group_of(), size))
    assert "prior 100\u202f%" in texts
    assert {"0", "256", "512", "0\u202f%", "100\u202f%", size.epochs_label} <= set(texts)


def test_the_same_numbers_give_the_same_bytes_and_leave_the_settings_alone():
    before = dict(mpl.rcParams)
    assert learning_curves(group_of()) == learning_curves(group_of())
    assert dict(mpl.rcParams) == before


def test_other_numbers_give_another_picture():
    assert learning_curves(group_of()) != learning_curves(group_of(RATES, states=20))


def test_figures_fetch_nothing_and_hold_no_date():
    for svg in (learning_curves(group_of()), loss_curves([loss_curve("pretrain", [1.0, 0.5])], ["scratch"])):
        links = re.findall(rb'(?:href|src)="([^"]*)"', svg)
        assert all(link.startswith(b"#") for link in links)
        assert b"dc:date" not in svg
        assert b"<script" not in svg


def test_one_checkpoint_can_be_drawn():
    assert "prior 100\u202f%" in texts_of(learning_curves(group_of({"prior": {0: 1.0}, "scratch": {0: 0.5}})))


def test_many_checkpoints_do_not_crowd_the_axis():
    rates = {"scratch": dict.fromkeys(range(250, 5001, 250), 0.5)}
    numbers = [text for text in texts_of(learning_curves(group_of(rates, states=5), NARROW)) if "," in text]
    assert len(numbers) <= 5
    assert "5,000" in numbers


def test_losses_are_grouped_by_stage_and_coloured_by_condition():
    curves = [
        loss_curve("pretrain", [0.9, 0.4, 0.2]),
        loss_curve("finetune/prior-s0", [0.3, 0.1]),
        loss_curve("finetune/scratch-s0", [0.9, 0.12]),
    ]
    svg = loss_curves(curves, ["prior", "scratch"])
    texts = texts_of(svg)
    assert {"pretrain", "prior-s0", "scratch-s0"} <= set(texts)
    assert sum(text.endswith("normalised action") for text in texts) == 2
    for colour in colours_of(["prior", "scratch"]).values():
        assert colour.encode() in svg


def test_a_loss_of_zero_can_be_drawn():
    assert b"<svg" in loss_curves([loss_curve("pretrain", [0.5, 0.0])], ["scratch"])


@given(st.lists(st.floats(0, 100), min_size=1, max_size=8))
def test_labels_keep_their_distance_and_their_order(heights):
    places = spread(heights, 10.0, 0.0, 100.0)
    assert len(places) == len(heights)
    ordered = sorted(places)
    assert all(above - below >= 10.0 - 1e-9 for below, above in pairwise(ordered))
    assert max(places) <= 100.0
    for one, other in zip(range(len(heights)), range(1, len(heights)), strict=False):
        if heights[one] < heights[other]:
            assert places[one] < places[other]


def test_labels_with_room_stay_where_they_are():
    assert spread([10.0, 80.0, 40.0], 10.0, 0.0, 100.0) == [10.0, 80.0, 40.0]


def luminance(colour):
    channels = [int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("colour", sorted({*COLOURS, *colours_of(["prior", "scratch"]).values()}))
def test_colours_are_dark_enough_to_be_read_as_text(colour):
    assert 1.05 / (luminance(colour) + 0.05) >= 4.5


def test_prior_and_scratch_keep_their_colours_among_many_conditions():
    many = colours_of([f"c{number}" for number in range(9)] + ["prior", "scratch"])
    few = colours_of(["prior", "scratch"])
    for name, colour in few.items():
        assert many[name] == colour
        assert list(many.values()).count(colour) == 1
